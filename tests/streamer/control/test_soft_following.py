"""Soft following by itself: between stiff and relaxed, slowly, and stiff at once where a joint is not known."""

from __future__ import annotations

from collections import deque

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from flexmotion.configs.robot import load_robot
from flexmotion.drivers.interface import RobotState
from flexmotion.drivers.plant import ServoPlant
from flexmotion.streamer.control.servo_command import ServoCommand
from flexmotion.streamer.control.soft_following import CHANGE_S, SoftFollowing

ROBOT = load_robot("op3")
N, RATE = 4, 125.0
SURE, UNSURE = np.zeros(N, np.bool_), np.ones(N, np.bool_)


def each(low: float, high: float) -> st.SearchStrategy[np.ndarray]:
    return arrays(np.float64, N, elements=st.floats(low, high))


@given(stiff=each(-3, 3), relaxed=each(-3, 3), asked=each(0.1, 1.0), ticks=st.integers(1, 60))
def test_goals_lie_between_the_relaxed_and_the_stiff_ones(
    stiff: np.ndarray, relaxed: np.ndarray, asked: np.ndarray, ticks: int
) -> None:
    softness = SoftFollowing(N, RATE)
    for _ in range(ticks):
        before, goal = softness.share.copy(), stiff.copy()
        softness.soften(goal, relaxed, asked, SURE)
        assert (np.abs(softness.share - before) <= 1.0 / (CHANGE_S * RATE) + 1e-12).all()
        assert (softness.share <= 1.0).all() and (softness.share >= asked - 1e-12).all()
        np.testing.assert_allclose(goal, relaxed + softness.share * (stiff - relaxed), atol=1e-12)
        np.testing.assert_allclose(goal + softness.way, stiff, atol=1e-12)
    if ticks > CHANGE_S * RATE:
        np.testing.assert_allclose(softness.share, asked)


def soft(**options: int) -> SoftFollowing:
    """Follows with a quarter of the stiffness, if it can."""
    softness = SoftFollowing(N, RATE, **options)
    for _ in range(100):
        softness.soften(np.ones(N), np.zeros(N), np.full(N, 0.25), SURE)
    return softness


def test_all_of_the_stiffness_comes_back_slowly_when_nothing_less_is_asked() -> None:
    softness = soft()
    goals = []
    for _ in range(30):
        goal = np.ones(N)
        softness.soften(goal, np.zeros(N), None, SURE)
        goals.append(goal[0])
    assert goals[0] < 0.3 and goals[-1] == 1.0
    assert np.diff(goals).max() <= 1.0 / (CHANGE_S * RATE) + 1e-12


def test_a_joint_of_which_nothing_is_known_is_stiff_at_once() -> None:
    softness, goal = soft(), np.ones(N)
    softness.soften(goal, np.zeros(N), np.full(N, 0.25), UNSURE)
    np.testing.assert_array_equal(goal, 1.0)


def test_joints_that_are_read_in_turns_are_always_stiff() -> None:
    softness, goal = soft(turns=3), np.ones(N)
    softness.soften(goal, np.zeros(N), np.full(N, 0.25), SURE)
    np.testing.assert_array_equal(goal, 1.0)


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_a_relaxed_goal_that_is_no_number_leaves_the_stiff_one(value: float) -> None:
    softness, goal, relaxed = soft(), np.ones(N), np.zeros(N)
    relaxed[2] = value
    with np.errstate(invalid="ignore"):
        softness.soften(goal, relaxed, np.full(N, 0.25), SURE)
    assert goal[2] == 1.0 and goal[0] == pytest.approx(0.25)


@pytest.mark.parametrize("share", [0.1, 0.3, 1.0])
@pytest.mark.parametrize("delay_ticks", [0, 1, 3])
@pytest.mark.parametrize("filter_s", [0.0, 0.08])
def test_a_joint_that_was_pushed_comes_to_rest_whatever_the_delay(
    share: float, delay_ticks: int, filter_s: float
) -> None:
    """The plant with the inertia of an OP3's shoulder; goals one tick and up to three more late, filtered speeds."""
    elbow, inertia, steps = ROBOT.index("l_el"), 0.05, 8
    plant, command = ServoPlant(ROBOT), ServoCommand(ROBOT, 0.004)
    plant.enabled[:] = True
    target, zero, stiffness = ROBOT.stand_pose, np.zeros(ROBOT.n), np.full(ROBOT.n, share)
    command.reset(target)
    plant.goal[:] = target
    q, qd, reported = target.copy(), np.zeros(ROBOT.n), np.zeros(ROBOT.n)
    q[elbow] += 0.08
    state, late, away = RobotState(ROBOT.n), deque([target.copy()] * (delay_ticks + 1)), []
    for _ in range(round(4.0 * ROBOT.rate_hz)):
        reported += (qd - reported) * (1.0 if not filter_s else 1.0 / ROBOT.rate_hz / filter_s)
        state.position[:], state.velocity[:], state.voltage[:] = ROBOT.from_ticks(ROBOT.to_ticks(q)), reported, 12.0
        late.append(command.update(target, zero, zero, state, stiffness=stiffness).copy())
        plant.goal[:] = late.popleft()
        for _ in range(steps):
            dt = 1.0 / ROBOT.rate_hz / steps
            qd[elbow] += plant.step(q, qd)[elbow] / inertia * dt
            q[elbow] += qd[elbow] * dt
        away.append(abs(q[elbow] - target[elbow]))
    assert max(away) < 0.1
    # Within a few units of the encoder, over the share: what is left of an error is less than a reading shows.
    assert max(away[-60:]) < 3.0 * ROBOT.tick_rad[elbow] / share
