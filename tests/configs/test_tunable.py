"""Numbers that may be tuned: each stays within its bounds, and a wrong name says what would be valid."""

from __future__ import annotations

from functools import reduce
from pathlib import Path

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from flexmotion.configs.errors import ConfigError
from flexmotion.configs.robot import Robot, load_robot
from flexmotion.configs.schema import read_yaml
from flexmotion.configs.tunable import ChosenNumber, choose_numbers, tunable_numbers, unusual_numbers
from flexmotion.configs.yaml_numbers import with_numbers

OP3 = load_robot("op3")
NAMES = tuple(tunable_numbers().numbers)
CHOSEN = choose_numbers(NAMES, OP3)
TEXT = OP3.file.read_text(encoding="utf-8")


def edited(tmp_path: Path, old: str, new: str) -> Robot:
    """OP3 with another line in its file."""
    assert old in TEXT
    for path in OP3.folder.iterdir():
        (tmp_path / path.name).symlink_to(path)
    (tmp_path / "op3.yaml").unlink()
    (tmp_path / "robot.yaml").write_text(TEXT.replace(old, new), encoding="utf-8")
    return load_robot(tmp_path)


@given(st.lists(st.floats(-0.5, 1.5), min_size=len(NAMES), max_size=len(NAMES)))
def test_whatever_is_asked_the_number_written_is_within_its_bounds(shares: list[float]) -> None:
    values = {number.at: number.value(share) for number, share in zip(CHOSEN, shares, strict=True)}
    for number in CHOSEN:
        assert number.low <= values[number.at] <= number.high


@given(st.sampled_from(CHOSEN), st.floats(0.0, 1.0))
def test_the_number_in_the_file_is_the_one_measured(number: ChosenNumber, share: float) -> None:
    value = number.value(share)
    content = yaml.safe_load(with_numbers(TEXT, {number.at: value}, OP3.file))
    assert reduce(lambda part, key: part[key], number.at, content) == value


def test_a_swing_foot_that_scuffs_the_floor_is_told_when_the_file_is_read(tmp_path: Path) -> None:
    """`flexmotion robots` accepted a clearance of 5 mm; the robot fell, and the warnings of its run blamed the IMU."""
    (told,) = unusual_numbers(edited(tmp_path, "clearance: 0.015", "clearance: 0.005"))
    assert "field gait.clearance: 0.005 m, expected 0.01015 to 0.03045 m (0.05 to 0.15 times hip_height)" in told
    assert unusual_numbers(OP3) == ()


def test_the_start_is_the_number_in_the_robot_file() -> None:
    content = read_yaml(OP3.file)
    for number in CHOSEN:
        assert number.start == reduce(lambda part, key: part[key], number.at, content)
        assert number.value(number.start_share) == pytest.approx(number.start, rel=1e-4)


@pytest.mark.parametrize("end", ["low", "high"])
@pytest.mark.parametrize("number", CHOSEN, ids=NAMES)
def test_a_robot_file_with_a_number_at_its_bound_is_valid(number: ChosenNumber, end: str, tmp_path: Path) -> None:
    text = with_numbers(TEXT, {number.at: getattr(number, end)}, OP3.file)
    for path in OP3.folder.iterdir():
        if path != OP3.file:
            (tmp_path / path.name).symlink_to(path)
    (tmp_path / "robot.yaml").write_text(text, encoding="utf-8")
    loaded = load_robot(tmp_path)
    assert reduce(lambda part, key: part[key], number.at, loaded.config.model_dump()) == getattr(number, end)


@pytest.mark.parametrize(
    ("names", "told"),
    [
        ([], "no numbers to tune, expected some of: gait.walk_hip_height"),
        (["gait.clearence"], "unknown number 'gait.clearence'; expected some of: gait.walk_hip_height"),
        (["gait.lateral"], "gait.lateral is not tuned: the feet touch"),
        (["safety.fall_tilt"], "safety.fall_tilt is not tuned: its thresholds"),
        (["gait.clearance", "gait.clearance"], "gait.clearance is given twice"),
    ],
)
def test_a_wrong_name_says_what_would_be_valid(names: list[str], told: str) -> None:
    with pytest.raises(ConfigError) as caught:
        choose_numbers(names, OP3)
    assert told in str(caught.value)


def test_the_order_of_names_does_not_matter() -> None:
    assert choose_numbers(NAMES[::-1], OP3) == CHOSEN


def test_a_number_that_the_file_lacks_needs_a_start(tmp_path: Path) -> None:
    pace = next(line for line in TEXT.splitlines() if line.strip().startswith("pace:"))
    robot = edited(tmp_path, pace, "")
    with pytest.raises(ConfigError, match=r"robot\.yaml: field gait\.pace\.ahead: missing; write a number from"):
        choose_numbers(["gait.pace.ahead"], robot)


def test_a_number_outside_its_bounds_is_refused_with_them(tmp_path: Path) -> None:
    robot = edited(tmp_path, "clearance: 0.015", "clearance: 0.05")
    with pytest.raises(
        ConfigError, match=r"field gait\.clearance: 0\.05 is not between its bounds 0\.01015 and 0\.03045"
    ):
        choose_numbers(["gait.clearance"], robot)
