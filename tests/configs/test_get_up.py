"""The key poses by which a robot gets up are checked when it is loaded."""

from __future__ import annotations

import re
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from flexmotion.configs.errors import ConfigError
from flexmotion.configs.get_up import FILE, MINIMUM_JERK_PEAK, SPEED_SHARE
from flexmotion.configs.robot import ROBOTS, Robot, load_robot


def test_op3_gets_up_from_both_sides_and_ends_in_its_stand_pose(op3: Robot) -> None:
    assert set(op3.get_up.steps) == {"front", "back"} and not op3.get_up.unfit
    for steps in op3.get_up.steps.values():
        assert np.allclose(steps[-1].q, op3.stand_pose, atol=1e-3)
        for before, after in zip(steps, steps[1:], strict=False):
            speed = MINIMUM_JERK_PEAK * np.abs(after.q - before.q) / after.seconds
            assert (speed <= SPEED_SHARE * op3.no_load_speed + 1e-9).all()


def loaded(folder: Path, edit: Callable[[dict[str, Any]], None]) -> Robot:
    """OP3 with an edited file."""
    mine = Path(shutil.copytree(ROBOTS / "op3", folder / "op3"))
    content = yaml.safe_load((mine / FILE).read_text())
    edit(content)
    (mine / FILE).write_text(yaml.safe_dump(content))
    return load_robot(mine)


def test_a_side_may_be_missing_and_so_may_the_file(tmp_path: Path) -> None:
    assert set(loaded(tmp_path, lambda content: content.pop("back")).get_up.steps) == {"front"}
    (tmp_path / "op3" / FILE).unlink()
    assert not load_robot(tmp_path / "op3").get_up.steps


@pytest.mark.parametrize(
    ("edit", "says"),
    [
        (lambda c: c["front"][1]["pose"].update(l_kne=0.1), "front, step 'reach over the head': unknown joint 'l_kne'"),
        (lambda c: c["back"][2].update(pitch=[0.2, 0.1]), r"pitch \[0.2, 0.1\] must be \[lower, higher\]"),
        (lambda c: c["front"][0].update(speed=3), "field front.0.speed"),
        (lambda c: c["front"][0].pop("pitch"), "field front.0.pitch"),
        (lambda c: c.update(front=[]), "field front"),
        (lambda c: c.update(version=2), "get-up file of version 2, this release reads 1"),
        (lambda c: [one.update(hold_s=5.0, wait_s=5.0) for one in c["back"]], "expected at most 40"),
    ],
)
def test_what_is_wrong_is_named(tmp_path: Path, edit: Callable[[dict[str, Any]], None], says: str) -> None:
    with pytest.raises(ConfigError, match=FILE) as error:
        loaded(tmp_path, edit)
    assert error.match(says)


@pytest.mark.parametrize(
    ("side", "edit", "says"),
    [
        ("front", lambda step: step["pose"].update(l_knee=2.6), r"l_knee: 2.6 is outside the joint's limits"),
        ("back", lambda step: step.update(seconds=0.1), "'push up': field seconds: 0.1 is too short, joint"),
    ],
)
def test_a_robot_that_the_steps_are_not_for_is_a_robot_that_does_not_get_up(
    tmp_path: Path, side: str, edit: Callable[[dict[str, Any]], None], says: str
) -> None:
    """A copy of OP3 with narrower joint limits or slower servos was refused for the poses of a get-up it never made."""
    push_up = next(number for number, step in enumerate(load_robot("op3").get_up.steps[side]) if step.name == "push up")
    found = loaded(tmp_path, lambda content: edit(content[side][push_up])).get_up
    assert set(found.steps) == {"front", "back"} - {side} and set(found.unfit) == {side}
    assert re.search(says, found.unfit[side]) and FILE in found.unfit[side]
