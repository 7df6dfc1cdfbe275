"""The gains of a push correction are checked when a robot is loaded, and mirrored for its right foot."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import yaml

from flexmotion.configs.errors import ConfigError
from flexmotion.configs.push_correction import DIRECTIONS, FILE
from flexmotion.configs.robot import ROBOTS, Robot, load_robot


def loaded(folder: Path, edit: Callable[[dict[str, Any]], None]) -> Robot:
    """OP3 with an edited file."""
    mine = Path(shutil.copytree(ROBOTS / "op3", folder / "op3"))
    content = yaml.safe_load((mine / FILE).read_text())
    edit(content)
    (mine / FILE).write_text(yaml.safe_dump(content))
    return load_robot(mine)


def test_a_robot_without_the_file_has_no_correction(tmp_path: Path) -> None:
    loaded(tmp_path, lambda content: None)
    (tmp_path / "op3" / FILE).unlink()
    assert load_robot(tmp_path / "op3").push_correction is None


def test_gains_of_the_right_foot_are_those_of_the_left_in_a_mirror(op3: Robot) -> None:
    correction = op3.push_correction
    assert correction is not None and correction.gains.any() and not correction.gains.flags.writeable
    left, right = (op3.chain(f"{side}_leg") for side in ("left", "right"))
    for part in left:
        for side in (0, 1):
            one, other = correction.gains[side, left[part]], correction.gains[1 - side, right[part]]
            assert (one == -other).all() and len(one) == len(DIRECTIONS)


@pytest.mark.parametrize(
    ("edit", "says"),
    [
        (lambda c: c["outward"].update(l_ank_rol=1.0), "field outward: unknown joint 'l_ank_rol', did you mean: l_ank"),
        (lambda c: c["ahead"].update(head_pan=1.0), "field ahead.head_pan: the joint has no mirror image, expected"),
        (lambda c: c["ahead"].update(l_knee=float("inf")), "field ahead.l_knee"),
        (lambda c: c.update(dead=[0.0, 0.02]), "field dead.0"),
        (lambda c: c.update(begins=[0.01, 0.05]), "is below dead"),
        (lambda c: c.update(most=2.0), "field most"),
        (lambda c: c.update(forward={}), "field forward"),
        (lambda c: c.update(version=2), "push correction of version 2, this release reads 1"),
    ],
)
def test_what_is_wrong_is_named(tmp_path: Path, edit: Callable[[dict[str, Any]], None], says: str) -> None:
    with pytest.raises(ConfigError, match=FILE) as error:
        loaded(tmp_path, edit)
    assert error.match(says)
