"""A robot that is too heavy for its servos is told before it falls."""

from __future__ import annotations

import re
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
    assert told is not None and "knee needs" in told and "add up to 135" in told
    assert execute(["robots", str(robot)]) == 0
    assert "in kilograms" in " ".join(capsys.readouterr().out.split())


def test_what_is_told_of_a_heavy_robot_says_what_would_be_valid(tmp_path: Path) -> None:
    """It ended in "expected the robot's masses in kilograms, and its servos", which told nobody what to change."""
    told = overloaded(load_robot(op3_with(tmp_path, "op3.xml", 'mass="1.34928"', 'mass="8"')))
    assert told is not None
    found = re.search(
        r"l_knee needs ([\d.]+) N·m, its servo XM430-W350 gives 2\.5: .* Expected a servo that gives \1 or more, or a "
        r"robot of ([\d.]+) kg at most; the MJCF's masses add up to 9\.798 kg: are they in kilograms\?",
        told,
    )
    assert found is not None
    asked, most = map(float, found.groups())
    assert most == pytest.approx(9.798 * 2.5 / asked, rel=0.01)  # torques of a stand are as the weight


def test_a_slightly_heavier_robot_is_not(tmp_path: Path) -> None:
    assert overloaded(load_robot(op3_with(tmp_path, "op3.xml", 'mass="1.34928"', 'mass="1.6"'))) is None
