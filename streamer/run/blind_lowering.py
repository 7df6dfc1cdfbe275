"""`blind_lowering`: goals that lower a robot without measurements, for the case that the control loop has failed."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from flexmotion.configs.get_up import MINIMUM_JERK_PEAK
from flexmotion.configs.robot import Robot
from flexmotion.spatial.transitions import minimum_jerk

Float = NDArray[np.float64]


def blind_lowering(robot: Robot, goal: Float) -> Iterator[Float]:
    """Goals for every tick: hold `goal`, (n,) [rad], for `lost_bus_hold_s`, then move to the rest pose.

    Yields:
        Goals, (n,) [rad], within the joints' limits or no further outside than `goal`.
    """
    safety, rest = robot.safety, robot.rest_pose
    for _ in range(round(safety.lost_bus_hold_s * robot.rate_hz)):
        yield goal.copy()
    # A minimum-jerk profile peaks at 15/8 of its mean speed.
    slowest = MINIMUM_JERK_PEAK * float(np.abs(rest - goal).max()) / (2 * safety.soft_start_speed)
    ticks = math.ceil(max(safety.park_s, slowest) * robot.rate_hz)
    for tick in range(1, ticks + 1):
        yield goal + float(minimum_jerk(np.array(tick / ticks))) * (rest - goal)
