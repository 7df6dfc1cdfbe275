"""A foot that is set down ahead lands heel first: its pitch is corrected from step to step."""

from __future__ import annotations

import math

import mujoco
import numpy as np
import pytest

from flexmotion.configs.robot import load_robot
from flexmotion.configs.stream import load_stream
from flexmotion.drivers.interface import RobotState
from flexmotion.importers.default_clip import default_clip
from flexmotion.retarget.plan import Plan
from flexmotion.retarget.retargeter import Retargeter
from flexmotion.streamer.control.estimator import Estimator
from flexmotion.streamer.control.heel_strike import TOES_UP, HeelStrike
from flexmotion.streamer.control.reference import Reference

ROBOT = load_robot("op3")
RETARGETER = Retargeter(ROBOT, load_stream())
LEGS = RETARGETER.body.legs
WALK: Plan = RETARGETER.plan(RETARGETER.standing(), default_clip()[225:300], 0, 0)


def ahead_of_the_other(row: int, side: int) -> float:
    """Way from the other sole to this one along its heading [m]."""
    (x, y, _, yaw), (other_x, other_y, _, _) = WALK.feet[row, side], WALK.feet[row, 1 - side]
    return math.cos(yaw) * (x - other_x) + math.sin(yaw) * (y - other_y)


AHEAD = next(step for step in WALK.steps if ahead_of_the_other(step.land, step.side) > 0.06)
"""The first step of a walk that lands ahead of the other foot by more than half a sole."""
MOST, RATE = 0.06, ROBOT.rate_hz
HALF_LENGTH = float(ROBOT.sole_half_size[AHEAD.side, 0])


def soles(q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Centres (2, 3) [m] and directions ahead (2, 3) of both soles of an upright torso at the origin."""
    data = mujoco.MjData(ROBOT.model)
    data.qpos[:3], data.qpos[3], data.qpos[ROBOT.qpos_address] = 0.0, 1.0, q
    mujoco.mj_kinematics(ROBOT.model, data)
    turns = np.stack([data.xmat[body].reshape(3, 3) for body in ROBOT.foot_ids])
    places = np.stack([data.xpos[body] for body in ROBOT.foot_ids])
    return places + np.einsum("sij,sj->si", turns, np.asarray(ROBOT.soles)), turns[:, :, 0]


def step(
    heel: HeelStrike, toes_down: float = 0.0, *, follows: bool = True, measured: bool = True, hung: bool = False
) -> tuple[float, np.ndarray]:
    """Make the step; pitch of the sole, toes down, and way of its centre (3,) against the plan at its end [rad, m].

    Args:
        toes_down: that the ankle of the foot is off its reference, beside what the offsets do [rad].
        follows: whether the joints follow the offsets.
    """
    estimator, reference, state = Estimator(ROBOT, RETARGETER.omega), Reference(ROBOT.n), RobotState(ROBOT.n)
    leg, pitch, moved = LEGS[AHEAD.side], 0.0, np.zeros(3)
    for row in range(AHEAD.lift - 2, AHEAD.land + round(0.5 * RATE)):
        reference.take(WALK, float(min(row, AHEAD.land)))
        state.position[:], state.imu_stale = reference.q, 0
        state.position += heel.offset * follows
        state.position[leg.indices[4]] += leg.signs[4] * toes_down
        estimator.update(state, reference)
        before = heel.offset.copy()
        heel.update(estimator, reference, measured=measured, hung=hung)
        assert np.allclose(heel.offset - before, heel.speed / RATE, atol=2e-5), "the rate is that of the offset"
        if row == AHEAD.land - 1:
            (planned, level), (found, ahead) = soles(reference.q), soles(reference.q + heel.offset)
            pitch = math.asin(level[AHEAD.side, 2]) - math.asin(ahead[AHEAD.side, 2])
            moved = (found - planned)[AHEAD.side]
    return pitch, moved


def test_toes_that_landed_first_are_raised_in_the_next_steps() -> None:
    """The toes of OP3's fastest walk struck 40 ms early, 1.4° down; feet that bounced slipped by 6.4 mm/s."""
    heel = HeelStrike(ROBOT, RETARGETER)
    first, _ = step(heel, 0.02)
    assert first == pytest.approx(0.0, abs=1e-4), "nothing is known of the robot before it has made a step"
    found = [step(heel, 0.02)[0] for _ in range(8)]
    assert found[0] < 0.0 and np.all(np.diff(found) < 0.0)
    assert found[-1] == pytest.approx(-TOES_UP - 0.02, abs=0.002)


def test_a_sole_that_already_lands_heel_first_is_left_alone() -> None:
    heel = HeelStrike(ROBOT, RETARGETER)
    step(heel, -TOES_UP)
    assert abs(step(heel, -TOES_UP)[0]) < 0.002


def test_a_heel_comes_down_as_the_plan_has_the_sole() -> None:
    """A heel 2 mm below the plan struck 40 ms early: the foot bounced, and stood 56 ms after its planned landing."""
    heel = HeelStrike(ROBOT, RETARGETER)
    heel.toes_up[:] = TOES_UP
    estimator, reference = Estimator(ROBOT, RETARGETER.omega), Reference(ROBOT.n)
    for row in range(AHEAD.lift - 2, AHEAD.land):
        reference.take(WALK, float(row))
        heel.update(estimator, reference, measured=False)
    (planned, level), (found, ahead) = soles(reference.q), soles(reference.q + heel.offset)
    heels = (centres[AHEAD.side] - HALF_LENGTH * way[AHEAD.side] for centres, way in ((planned, level), (found, ahead)))
    sole, struck = (place[2] for place in heels)
    assert ahead[AHEAD.side, 2] > 0.9 * math.sin(TOES_UP)
    assert struck == pytest.approx(sole, abs=2e-4)


def test_the_sole_pitches_and_is_raised_within_bounds_and_comes_back() -> None:
    heel = HeelStrike(ROBOT, RETARGETER)
    for _ in range(12):
        pitch, moved = step(heel, 0.1, follows=False)
    assert pitch == pytest.approx(-MOST, abs=0.004)
    np.testing.assert_allclose(moved, [0.0, 0.0, HALF_LENGTH * math.sin(TOES_UP)], atol=5e-4)
    assert not heel.offset.any() and not heel.speed.any(), "the foot that carries the robot is as planned"
    other = LEGS[1 - AHEAD.side].indices
    heel.reset()
    heel.update(*_mid_swing(), measured=False)
    assert heel.offset.any() and not heel.offset[other].any()
    heel.reset()
    assert not heel.offset.any() and heel.toes_up[AHEAD.side] == MOST, "what was learnt is kept"


def _mid_swing() -> tuple[Estimator, Reference]:
    reference = Reference(ROBOT.n)
    reference.take(WALK, float(AHEAD.land - 8))
    return Estimator(ROBOT, RETARGETER.omega), reference


@pytest.mark.parametrize("unfit", [{"measured": False}, {"hung": True}])
def test_nothing_is_learnt_from_a_step_that_tells_nothing(unfit: dict[str, bool]) -> None:
    heel = HeelStrike(ROBOT, RETARGETER)
    step(heel, 0.05, **unfit)
    assert not heel.toes_up.any()


def test_without_feedback_the_plan_is_followed() -> None:
    heel = HeelStrike(ROBOT, RETARGETER, enabled=False)
    step(heel, 0.05)
    pitch, moved = step(heel, 0.05)
    assert pitch == 0.0 and not moved.any()


def test_a_step_back_is_left_as_it_is_planned() -> None:
    """Its toes reach behind: raised, its heel would strike before the foot is there."""
    heel = HeelStrike(ROBOT, RETARGETER)
    heel.toes_up[:] = MOST
    estimator, reference = _mid_swing()
    there, other = reference.feet[AHEAD.side], reference.feet[1 - AHEAD.side]
    there[:2] = 2.0 * other[:2] - there[:2]
    heel.update(estimator, reference, measured=True)
    assert not heel.offset.any()


def test_a_foot_that_lifts_ahead_and_steps_back_is_left_as_it_is_planned() -> None:
    """It was raised while it was still ahead: of 16 perturbed walks back 4 fell, of 16 without it none."""
    heel = HeelStrike(ROBOT, RETARGETER)
    heel.toes_up[:] = MOST
    estimator, reference = _mid_swing()
    there, other = reference.feet[AHEAD.side], reference.feet[1 - AHEAD.side]
    way = there[:2] - other[:2]
    reference.contacts[AHEAD.side] = True
    heel.update(estimator, reference, measured=True)
    reference.contacts[AHEAD.side] = False
    for share in (1.0, 0.8, 0.5, 0.1, -0.5, -1.0):
        there[:2] = other[:2] + share * way
        heel.update(estimator, reference, measured=True)
        assert not heel.offset.any()


def test_a_straight_leg_turns_its_sole_by_the_ankle_alone() -> None:
    """A knee that was quite straight divided by zero: the loop ended in the middle of a step."""
    heel, leg = HeelStrike(ROBOT, RETARGETER), LEGS[0]
    for bend in (0.0, 1e-9, 0.05, 0.3):
        q = np.zeros(ROBOT.n)
        q[leg.indices[3]] = leg.signs[3] * bend
        found = heel._raised(0, TOES_UP, 0.002, q)
        assert np.isfinite(found).all() and np.abs(found).max() <= 0.15
        assert (leg.signs * found)[2:5].sum() == pytest.approx(-TOES_UP, abs=1e-9) or bend > 0.1
        if bend < 0.1:
            np.testing.assert_array_equal(found[[2, 3]], 0.0)
