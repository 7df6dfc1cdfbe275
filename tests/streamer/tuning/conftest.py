"""Plans of campaigns on lists of one clip each."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import pytest

from flexmotion.configs.robot import load_robot
from flexmotion.configs.tunable import choose_numbers
from flexmotion.streamer.tuning.campaign import Plan
from flexmotion.streamer.tuning.clip_list import ClipList

from .formula import NUMBERS


@pytest.fixture
def lists(tmp_path: Path) -> Path:
    """Folder with the lists `tuned.yaml` and `reported.yaml`."""
    (tmp_path / "tuned.yaml").write_text("walking: [{velocity: [0.5, 0, 0], seconds: 2}]\n")
    (tmp_path / "reported.yaml").write_text("walking: [{velocity: [0.6, 0, 0], seconds: 2}]\n")
    return tmp_path


@pytest.fixture
def plan(lists: Path) -> Callable[..., Plan]:
    """Makes plans; arguments replace those given here."""
    robot = load_robot("op3")

    def make(numbers: Sequence[str] = NUMBERS, **others: object) -> Plan:
        own: dict[str, object] = {"generations": 4, "seed": 3, "population": 5} | others
        clips, report = own.pop("clips", lists / "tuned.yaml"), own.pop("report", lists / "reported.yaml")
        chosen = choose_numbers(numbers, robot)
        return Plan(robot, chosen, ClipList(str(clips)), ClipList(str(report)), **own)  # type: ignore[arg-type]

    return make
