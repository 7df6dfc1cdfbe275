"""A robot file whose soles the robot cannot stand on is refused, or told, before anything runs."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import yaml

from flexmotion.configs.errors import RetargetError
from flexmotion.configs.robot import ROBOTS, Robot, load_robot
from flexmotion.retarget.stand_check import unbalanced
from flexmotion.retarget.whole_body import WholeBody


def edited(tmp_path: Path, edit: Callable[[dict[str, Any]], object]) -> Robot:
    """OP3 with an edited file."""
    folder = Path(shutil.copytree(ROBOTS / "op3", tmp_path / "op3"))
    content = yaml.safe_load((folder / "op3.yaml").read_text(encoding="utf-8"))
    edit(content)
    (folder / "op3.yaml").write_text(yaml.safe_dump(content), encoding="utf-8")
    return load_robot(folder)


@pytest.mark.parametrize(
    ("edit", "says"),
    [
        (lambda c: c["stand_pose"].pop("l_knee"), "field stand_pose: the soles are not on one floor: .* by 0.79 rad"),
        (
            lambda c: c["feet"]["left"].update(sole=[0.024, -0.0128, -0.0305]),
            "field feet: .* left sole is over the right",
        ),
        (lambda c: c["feet"]["left"].update(sole=[0.024, -0.1, -0.0305]), "field feet: .* is right of the right one"),
    ],
)
def test_soles_that_nothing_can_stand_on_are_refused(
    tmp_path: Path, edit: Callable[[dict[str, Any]], object], says: str
) -> None:
    """A stand pose without one knee, or a sole's y of the wrong sign, was accepted without a word; the robot fell."""
    with pytest.raises(RetargetError, match=says) as error:
        WholeBody(edited(tmp_path, edit))
    assert "op3.yaml" in str(error.value) and "\n" not in str(error.value)


@pytest.mark.parametrize("lateral", [[0.3, 0.4], [0.05, 0.08]])
def test_a_stand_that_no_step_could_end_in_is_refused(tmp_path: Path, lateral: list[float]) -> None:
    """`gait.lateral: [0.3, 0.4]` with feet .1 m apart was accepted; the robot fell after four seconds of a walk."""
    with pytest.raises(RetargetError, match=r"op3\.yaml: field gait\.lateral: .* m, expected .* 0\.096 between them"):
        WholeBody(edited(tmp_path, lambda c: c["gait"].update(lateral=lateral)))


def test_a_stand_that_falls_is_told(tmp_path: Path) -> None:
    """A stand pose without the ankles was accepted without a word."""
    robot = edited(tmp_path, lambda c: [c["stand_pose"].pop(joint) for joint in ("l_ank_pitch", "r_ank_pitch")])
    assert "the robot falls in its stand pose" in (unbalanced(robot) or "")


def test_the_shipped_robot_stands() -> None:
    assert unbalanced(load_robot("op3")) is None
