from __future__ import annotations

import numpy as np
import pytest

from flexmotion.configs.robot import Robot
from flexmotion.drivers.receiver import Receiver


@pytest.fixture
def receiver(op3: Robot) -> Receiver:
    receiver = Receiver(op3)
    receiver.pin(op3.stand_pose)
    return receiver


def send(
    receiver: Receiver, robot: Robot, *, goal: np.ndarray, speed: float = 0.0, on: bool = True, volts: float = 12.0
) -> None:
    position = robot.stand_pose.copy()
    receiver.receive(goal, position, np.full(robot.n, speed), volts, np.full(robot.n, on))


def test_goals_are_taken_in_whole_ticks(op3: Robot, receiver: Receiver) -> None:
    send(receiver, op3, goal=op3.stand_pose + 0.0123)
    ticks = receiver.goal / op3.tick_rad
    np.testing.assert_allclose(ticks, np.rint(ticks), atol=1e-9)
    assert np.abs(receiver.goal - op3.stand_pose - 0.0123).max() <= op3.tick_rad[0] / 2 + 1e-12
    assert receiver.violations == 0


def test_a_goal_beyond_a_limit_is_counted_once_a_joint(op3: Robot, receiver: Receiver) -> None:
    goal = op3.stand_pose.copy()
    knee = op3.index("l_knee")
    goal[knee] = op3.upper[knee] + 3 * op3.tick_rad[knee]
    send(receiver, op3, goal=goal)
    assert receiver.position_violations == 1
    goal[knee] = 1e9
    send(receiver, op3, goal=goal)
    assert receiver.position_violations == 2


def test_a_goal_on_the_limit_is_fine(op3: Robot) -> None:
    receiver = Receiver(op3)
    receiver.receive(op3.upper, op3.upper.copy(), np.zeros(op3.n), 12.0, np.ones(op3.n, np.bool_))
    receiver.receive(op3.lower, op3.lower.copy(), np.zeros(op3.n), 12.0, np.ones(op3.n, np.bool_))
    assert receiver.violations == 0


def test_a_goal_that_implies_more_than_the_peak_is_counted(op3: Robot, receiver: Receiver) -> None:
    reach = op3.stall_torque / op3.kp
    elbow = np.arange(op3.n) == op3.index("l_el")
    send(receiver, op3, goal=op3.stand_pose + 0.98 * reach * elbow)
    assert receiver.torque_violations == 0
    send(receiver, op3, goal=op3.stand_pose + 1.03 * reach * elbow)
    assert receiver.torque_violations == 1


def test_a_fast_joint_allows_goals_further_ahead_but_not_behind(op3: Robot, receiver: Receiver) -> None:
    elbow = np.arange(op3.n) == op3.index("l_el")
    ahead = 1.2 * op3.stall_torque / op3.kp * elbow
    send(receiver, op3, goal=op3.stand_pose + ahead, speed=2.0)
    assert receiver.torque_violations == 0
    send(receiver, op3, goal=op3.stand_pose - ahead, speed=2.0)
    assert receiver.torque_violations == 1


def test_the_count_does_not_depend_on_the_supply_at_rest(op3: Robot, receiver: Receiver) -> None:
    """Gain and peak of a PWM loop both scale with the supply."""
    reach = op3.stall_torque / op3.kp * (np.arange(op3.n) == op3.index("l_el"))
    for volts in (10.0, 14.0):
        send(receiver, op3, goal=op3.stand_pose + 0.98 * reach, volts=volts)
        assert receiver.torque_violations == 0


def test_goals_to_servos_that_are_off_are_not_counted(op3: Robot, receiver: Receiver) -> None:
    send(receiver, op3, goal=np.full(op3.n, 9.0), on=False)
    assert receiver.violations == 0


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_a_goal_that_is_not_a_number_is_counted_and_not_taken(op3: Robot, receiver: Receiver, bad: float) -> None:
    goal = op3.stand_pose.copy()
    goal[3] = bad
    before = receiver.goal.copy()
    send(receiver, op3, goal=goal)
    assert receiver.position_violations == 1
    np.testing.assert_allclose(receiver.goal, before, atol=1e-12)


def test_outside_its_limit_a_joints_goals_may_only_move_inside(op3: Robot) -> None:
    """Regression: a limp robot rests on its stops, and a goal pinned there was refused or counted."""
    receiver, on, still = Receiver(op3), np.ones(op3.n, np.bool_), np.zeros(op3.n)
    knee, position = op3.index("l_knee"), op3.stand_pose.copy()
    position[knee] = op3.upper[knee] + 0.1

    def sent(offset: float, at: float = 0.0) -> int:
        """Violations of a goal, for goal and joint at these distances from the joint's first position [rad]."""
        goal, where = position.copy(), position.copy()
        goal[knee] += offset
        where[knee] += at
        before = receiver.position_violations
        receiver.receive(goal, where, still, 12.0, on)
        return receiver.position_violations - before

    receiver.pin(position)
    assert sent(0.0) == 0
    assert sent(0.01) == 1
    # The joint moves inside before its goal: the goal may stay, but not move out again.
    assert sent(-0.02, at=-0.04) == 0 and sent(-0.02, at=-0.06) == 0
    assert sent(-0.01, at=-0.06) == 1
    assert sent(-0.15, at=-0.15) == 0 and sent(-0.09, at=-0.15) == 1


def test_only_the_first_goal_may_be_at_the_joints_position(op3: Robot) -> None:
    """Regression: a joint pushed past its limit during a run took its goals along, and none was counted."""
    on, still = np.ones(op3.n, np.bool_), np.zeros(op3.n)
    knee = op3.index("l_knee")
    outside = op3.stand_pose.copy()
    outside[knee] = op3.upper[knee] + 0.08

    receiver = Receiver(op3)
    receiver.pin(op3.stand_pose)
    receiver.receive(op3.stand_pose, op3.stand_pose, still, 12.0, on)
    receiver.receive(outside, outside, still, 12.0, on)
    assert receiver.position_violations == 1

    # After torque off the goal is pinned to the joint's position, and starts there.
    receiver.receive(outside, outside, still, 12.0, on & (np.arange(op3.n) != knee))
    receiver.receive(outside, outside, still, 12.0, on)
    assert receiver.position_violations == 1
