"""Numbers in the text of a YAML file: they change, and nothing else does."""

from __future__ import annotations

from pathlib import Path

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from flexmotion.configs.errors import ConfigError
from flexmotion.configs.yaml_numbers import with_numbers, written

FILE = Path("robot.yaml")
TEXT = """\
# A robot – with a comment.
gait:
  clearance: 0.015   # of the swing foot
  zmp: [0.045, 0.024]  # along, across
  pace: {ahead: 0.23, back: 1}
name: op3
"""


def test_comments_and_layout_stay() -> None:
    numbers = {("gait", "clearance"): 0.0123, ("gait", "zmp", 1): 0.5, ("gait", "pace", "back"): 0.25}
    changed = with_numbers(TEXT, numbers | {("gait", "zmp", 0): 1.0}, FILE)
    expected = TEXT.replace("0.015", "0.0123").replace("0.024", "0.5").replace("0.045", "1.0")
    assert changed == expected.replace("back: 1", "back: 0.25")


@given(st.floats(1e-12, 1e12))
def test_a_number_is_read_as_it_was_written(value: float) -> None:
    """Regression: YAML 1.1 reads 1e-05 as text."""
    assert yaml.safe_load(written(value)) == value


@pytest.mark.parametrize(
    ("text", "place", "told"),
    [
        (TEXT, ("gait", "stride"), "field gait.stride: not in the file, expected a number"),
        (TEXT, ("gait", "zmp", 2), "field gait.zmp.2: not in the file"),
        (TEXT, ("name",), "field name: expected a number"),
        (TEXT, ("gait",), "field gait: expected a number"),
        ("a: &x 0.5\nb: *x\n", ("a",), "field a: an anchor shares this number with other fields"),
        ("a: [", ("a",), "robot.yaml, line 1: not valid YAML"),
    ],
)
def test_a_place_without_a_number_of_its_own_is_refused(text: str, place: tuple[str | int, ...], told: str) -> None:
    with pytest.raises(ConfigError) as caught:
        with_numbers(text, {place: 1.0}, FILE)
    assert told in str(caught.value)
