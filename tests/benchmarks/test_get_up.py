"""`robot/get_up`: robots that collapsed limp get up, however their limbs came to lie."""

from __future__ import annotations

import pytest

from benchmarks.shared.fallen import Fallen
from flexmotion.configs.robot import Robot, load_robot
from flexmotion.configs.stream import load_stream
from flexmotion.retarget.retargeter import Retargeter


@pytest.fixture(scope="module")
def op3() -> Robot:
    return load_robot("op3")


@pytest.fixture(scope="module")
def retargeter(op3: Robot) -> Retargeter:
    return Retargeter(op3, load_stream())


@pytest.mark.parametrize("seed", [321, 15005])
def test_a_robot_that_lies_on_its_own_foot_gets_up(op3: Robot, retargeter: Retargeter, seed: int) -> None:
    """Its legs stretched at first, and lifted it onto that foot and its head: "pitched by -107°, expected -100°"."""
    robot = Fallen(op3, retargeter, "back", seed, limp=True)
    robot.fall()
    data = robot.driver.data
    torso = data.body("body_link")
    feet = [data.body(name).xpos - torso.xpos for name in ("l_ank_roll_link", "r_ank_roll_link")]
    assert all(foot @ torso.xmat.reshape(3, 3)[:, 0] < -0.035 for foot in feet), "both feet lie behind its back"
    got_up = robot.get_up()
    assert got_up.stood and got_up.violations == 0, got_up.reason


def test_a_robot_that_still_moves_is_asked_again(op3: Robot, retargeter: Retargeter) -> None:
    """A limp leg slid down as it was asked, and its answer, to ask again, counted as a robot that does not get up."""
    robot = Fallen(op3, retargeter, "back", 20005, limp=True)
    robot.fall()
    got_up = robot.get_up()
    assert got_up.asked == 2 and got_up.stood, got_up.reason
