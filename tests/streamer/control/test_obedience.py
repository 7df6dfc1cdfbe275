"""Joints that are blocked, loaded, on their way, and read in turns."""

from __future__ import annotations

from collections import deque
from copy import copy

import numpy as np
import pytest
from numpy.typing import NDArray

from flexmotion.configs.robot import Robot, load_robot
from flexmotion.streamer.control.obedience import CLOSING_S, PATIENCE_S, Obedience

Float = NDArray[np.float64]
RATE = 125.0
TICKS = int(2 * PATIENCE_S * RATE)


@pytest.fixture(scope="module")
def op3() -> Robot:
    return load_robot("op3")


class Followed:
    """A robot whose joint `name` the test moves.

    Attributes:
        goal, position: of all joints, (n,) [rad].
        limit: distance from its prediction at which the joint carries all its usable torque [rad].
        share: of its stiffness with which each joint follows, (n,).
    """

    def __init__(self, robot: Robot, name: str, turns: int = 1) -> None:
        self.obedience, self.joint = Obedience(robot, turns), robot.index(name)
        self.goal, self.position = robot.stand_pose.copy(), robot.stand_pose.copy()
        self.limit = float(robot.usable_torque[self.joint] / robot.kp[self.joint])
        self._nothing, self._known, self.share = np.zeros(robot.n), np.ones(robot.n, np.bool_), np.ones(robot.n)
        self.obedience.reset(robot.stand_pose)

    @property
    def predicted(self) -> float:
        return float(self.obedience.predicted[self.joint])

    def tick(self) -> None:
        self.obedience.update(self.goal, self._nothing, self.position, self._known, self.share)


def test_a_blocked_joint_does_not_follow_and_a_loaded_one_does(op3: Robot) -> None:
    knee = Followed(op3, "l_knee")
    knee.position[knee.joint] -= 0.4 * knee.limit  # a heavy robot sags
    for _ in range(TICKS):
        knee.tick()
    assert knee.obedience.worst is None
    knee.goal[knee.joint] += knee.limit
    for _ in range(TICKS):
        knee.tick()
    assert knee.obedience.worst == knee.joint
    assert f"stands still while they lead it by {knee.limit:.2f} rad" in knee.obedience.describe(knee.joint)


def test_a_soft_arm_is_judged_by_the_torque_that_it_makes(op3: Robot) -> None:
    """An arm at .3 of its stiffness was called blocked where a hand of 4 N held it, which a stiff one bore."""
    arm = Followed(op3, "l_sho_pitch")
    arm.share[:] = 0.3
    arm.position[arm.joint] += 1.8 * arm.limit
    for _ in range(TICKS):
        arm.tick()
    assert arm.obedience.worst is None
    arm.share[:] = 0.8
    arm.position[arm.joint] -= 0.9 * arm.limit
    for _ in range(TICKS):
        arm.tick()
    assert arm.obedience.worst == arm.joint
    assert f"{0.9 * arm.limit:.2f} rad from where they lead" in arm.obedience.describe(arm.joint)


def test_an_arm_that_lags_on_its_way_is_not_called_blocked(op3: Robot) -> None:
    """An arm that was raised fast lagged for .28 s in lockstep; on the wall clock a run was parked for it."""
    arm = Followed(op3, "l_sho_pitch")
    for tick in range(TICKS):
        arm.goal[arm.joint] = op3.stand_pose[arm.joint] + 4.0 * (tick + 1) / RATE
        # As fast as its goal, behind its prediction by nearly all that the servo can.
        late = max(0.0, arm.predicted - 0.9 * arm.limit)
        arm.position[arm.joint] = late
        arm.tick()
    assert arm.obedience.load[arm.joint] < -0.6
    assert arm.obedience.worst is None
    for _ in range(TICKS):  # it slips away from where the goals lead
        arm.goal[arm.joint] += 4.0 / RATE
        arm.position[arm.joint] -= 1.0 / RATE
        arm.tick()
    assert arm.obedience.worst == arm.joint


def test_a_joint_that_creeps_or_trembles_is_blocked(op3: Robot) -> None:
    """A blocked knee whose speed register was stuck at .35 rad/s counted as on its way: in 60 s it was not found."""
    knee = Followed(op3, "l_knee")
    knee.goal[knee.joint] += 2 * knee.limit
    for tick in range(TICKS):
        knee.position[knee.joint] = op3.stand_pose[knee.joint] + 0.05 * tick / RATE + 0.004 * (tick % 3)
        knee.tick()
    assert knee.obedience.worst == knee.joint and knee.obedience.blocked is None
    assert "rad from where they lead, or it is blocked" in knee.obedience.describe(knee.joint)


def test_a_slow_servos_joint_is_on_its_way_at_its_own_speed(op3: Robot) -> None:
    """The threshold was that of one servo: ten units in which it measures speed."""
    slow = copy(op3)
    slow.no_load_speed = 0.2 * op3.no_load_speed
    knee = Followed(slow, "l_knee")
    knee.goal[knee.joint] += 2 * knee.limit
    for _ in range(TICKS):
        knee.position[knee.joint] += 0.1 / RATE
        knee.tick()
    assert knee.obedience.worst is None


@pytest.mark.parametrize("turns", [8, 40])
def test_joints_that_are_read_in_turns_are_judged_by_where_they_were(op3: Robot, turns: int) -> None:
    """Joints of LX-16A servos were not judged at all: a blocked one was never found."""
    arm = Followed(op3, "l_sho_pitch", turns)
    past: deque[float] = deque([op3.stand_pose[arm.joint]] * (turns // 2 + 1), turns // 2 + 1)
    begin = op3.stand_pose[arm.joint]
    for tick in range(6 * TICKS):  # it follows exactly; its position is read every half of the turns
        arm.goal[arm.joint] = begin + 1.2 * np.sin(2 * np.pi * tick / RATE)
        if tick % (turns // 2) == 0:
            arm.position[arm.joint] = past[0]
        arm.tick()
        past.append(arm.predicted)
        assert arm.obedience.worst is None
    arm.goal[arm.joint] = begin + 1.0
    arm.position[arm.joint] = begin
    for _ in range(TICKS + int(CLOSING_S * RATE) + 2 * turns):
        arm.tick()
    assert arm.obedience.worst == arm.joint
