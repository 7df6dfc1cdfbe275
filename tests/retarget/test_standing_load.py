"""A robot that is too heavy for its servos is told before it falls."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from flexmotion.configs.robot import ROBOTS, list_robots, load_robot
from flexmotion.retarget.standing_load import overloaded
from flexmotion.streamer.cli import execute


def op3_with(folder: Path, file: str, old: str, new: str) -> Path:
    """A copy of OP3 with a text of one of its files replaced."""
    copy = Path(shutil.copytree(ROBOTS / "op3", folder / "op3"))
    text = (copy / file).read_text(encoding="utf-8")
    assert old in text
    (copy / file).write_text(text.replace(old, new), encoding="utf-8")
    return copy


@pytest.mark.parametrize("name", list_robots())
def test_robots_that_come_with_the_project_hold_themselves_on_one_foot(name: str) -> None:
    assert overloaded(load_robot(name)) is None


def test_a_mass_in_grams_is_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A torso of 1,349 kg was found to be in order, and the run blamed a servo that measures what cannot be."""
    robot = op3_with(tmp_path, "op3.xml", 'mass="1.34928"', 'mass="1349.28"')
    told = overloaded(load_robot(robot))
    assert told is not None and "knee needs" in told and "weighs 135" in told
    assert execute(["robots", str(robot)]) == 0
    assert "in kilograms" in " ".join(capsys.readouterr().out.split())


def test_a_slightly_heavier_robot_is_not(tmp_path: Path) -> None:
    assert overloaded(load_robot(op3_with(tmp_path, "op3.xml", 'mass="1.34928"', 'mass="1.6"'))) is None
