"""What keeps a robot without torque from being armed."""

from __future__ import annotations

import numpy as np
import pytest

from flexmotion.configs.robot import Robot, load_robot
from flexmotion.spatial.gravity import GRAVITY
from flexmotion.streamer.control.estimator import Estimator
from flexmotion.streamer.control.start_check import why_not_arm

STANDS, LIES = np.array([0.0, 0.2]), np.array([0.0, 1.5])


@pytest.fixture(scope="module")
def op3() -> Robot:
    return load_robot("op3")


def measured(pitch: float) -> np.ndarray:
    """Specific force of a torso at rest that is pitched so far, (3,) [m/s²]."""
    return GRAVITY * np.array([-np.sin(pitch), 0.0, np.cos(pitch)])


def believing(robot: Robot, tilt: np.ndarray, *, has_imu: bool = True) -> Estimator:
    found = Estimator(robot, 6.5)
    found.has_imu, found.tilt[:] = has_imu, tilt
    return found


def test_a_robot_that_stands_or_rests_is_armed(op3: Robot) -> None:
    assert why_not_arm(op3, believing(op3, STANDS), measured(0.3)) is None


def test_one_that_lies_is_not(op3: Robot) -> None:
    assert "the robot lies" in str(why_not_arm(op3, believing(op3, LIES), measured(1.5)))


def test_one_that_was_just_laid_down_or_set_up_is_not_either(op3: Robot) -> None:
    """The attitude follows over seconds: a robot that was laid down would have stood up lying."""
    for tilt, pitch in ((STANDS, 1.5), (LIES, 0.2)):
        assert "was moved" in str(why_not_arm(op3, believing(op3, tilt), measured(pitch)))


def test_what_is_no_gravity_says_nothing(op3: Robot) -> None:
    assert why_not_arm(op3, believing(op3, STANDS), 1.5 * measured(1.5)) is None


def test_without_an_imu_nothing_is_known(op3: Robot) -> None:
    assert why_not_arm(op3, believing(op3, LIES, has_imu=False), measured(1.5)) is None
