"""A robot without an IMU: one that swayed falls on, one that walked walks on."""

from __future__ import annotations

import math

import numpy as np
import pytest

from flexmotion.configs.robot import Robot, load_robot
from flexmotion.streamer.control.estimator import Estimator
from flexmotion.streamer.control.reference import Reference
from flexmotion.streamer.control.unseen_fall import UnseenFall

OMEGA = 6.5


@pytest.fixture(scope="module")
def op3() -> Robot:
    return load_robot("op3")


class Swaying:
    """A robot that plays a plan and sways by so much, to the right and ahead."""

    def __init__(self, robot: Robot) -> None:
        self.robot, self.watch = robot, UnseenFall(robot)
        self.estimator, self.planned = Estimator(robot, OMEGA), Reference(robot.n)

    def measure(self, tilt: float, rate: float) -> None:
        self.estimator.has_imu = True
        self.estimator.tilt[:] = tilt * np.array([0.6, 0.8])
        self.estimator.tilt_rate[:] = rate * np.array([0.6, 0.8])
        assert not self.watch.update(self.estimator, self.planned, measured=True)

    def falls_after(self, seconds: float, *, has_imu: bool = False) -> float | None:
        """When it is taken to have fallen [s]; None: not within this time."""
        self.estimator.has_imu = has_imu
        self.estimator.tilt[:], self.estimator.tilt_rate[:] = 0.0, 0.0  # that of the plan
        for tick in range(round(seconds * self.robot.rate_hz)):
            if self.watch.update(self.estimator, self.planned, measured=False):
                return (tick + 1) / self.robot.rate_hz
        return None


@pytest.fixture
def swaying(op3: Robot) -> Swaying:
    return Swaying(op3)


@pytest.mark.parametrize("tilt", [0.25, 0.35, 0.5])
def test_a_robot_that_sways_falls_as_fast_as_a_pendulum(swaying: Swaying, tilt: float) -> None:
    """It was upright for ever: the tilt of a robot without an IMU is that of its plan."""
    swaying.measure(tilt, 0.0)
    takes = math.acosh(swaying.robot.safety.fall_tilt / tilt) / OMEGA
    assert swaying.falls_after(2.0) == pytest.approx(
        takes, abs=0.02
    )  # roll and pitch together tilt by less than their sum of squares


def test_a_robot_that_is_still_upright_falls_by_its_speed(swaying: Swaying) -> None:
    swaying.measure(0.05, 2.0)
    assert swaying.falls_after(0.5) is not None


def test_a_walk_goes_on_for_minutes(swaying: Swaying) -> None:
    swaying.measure(0.07, 0.4)
    assert swaying.falls_after(200.0) is None


def test_a_bow_is_no_sway(swaying: Swaying) -> None:
    swaying.estimator.has_imu = True
    swaying.estimator.tilt[:] = 0.0, 0.5
    swaying.planned.base[3:] = math.cos(0.25), 0.0, math.sin(0.25), 0.0
    assert not swaying.watch.update(swaying.estimator, swaying.planned, measured=True)
    assert not swaying.watch.sways and swaying.falls_after(5.0) is None


def test_an_imu_that_is_believed_again_decides(swaying: Swaying) -> None:
    swaying.measure(0.3, 0.5)
    assert swaying.falls_after(0.1) is None
    swaying.measure(0.1, -0.3)
    assert swaying.falls_after(5.0) is None


def test_samples_that_are_not_believed_do_not_decide_while_there_is_an_imu(swaying: Swaying) -> None:
    """For as long as an IMU may be silent the last attitude holds."""
    swaying.measure(0.3, 2.0)
    assert swaying.falls_after(1.0, has_imu=True) is None
