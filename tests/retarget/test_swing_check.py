from __future__ import annotations

import numpy as np
import pytest

from flexmotion.retarget.retargeter import Retargeter
from flexmotion.retarget.state import SETTLED_STEPS, RetargetState
from flexmotion.retarget.steps import Step, pack_steps
from flexmotion.retarget.swing_check import Sway
from flexmotion.retarget.walk import Walk

TICKS = 52
"""Duration of the swings: .42 s, that of fast walks."""
STRIDE = 0.09


@pytest.fixture
def state(retargeter: Retargeter) -> RetargetState:
    """A robot in a stride, its left foot ahead, whose hips are low and over the left foot."""
    state = retargeter.layout.view(retargeter.standing())
    state.feet[0, 0] = STRIDE
    state.com = state.dcm = state.feet[0, :2]
    state.position[0] = retargeter.gait.walk_hip_height
    return state


def settled(state: RetargetState, *steps: tuple[int, int, float]) -> None:
    """Settle steps of `TICKS`: side, tick of the lift, x of the target [m]."""
    feet, made = state.feet.copy(), []
    for side, lift, x in steps:
        target = np.array([x, *feet[side, 1:]])
        made.append(Step(side, lift, lift + TICKS, feet[side].copy(), target, 1.0))
        feet[side] = target
    state.steps = pack_steps(made, SETTLED_STEPS)


def asked(retargeter: Retargeter, state: RetargetState, walk: Walk, com: np.ndarray) -> np.ndarray:
    reach = retargeter.body.reachable_height(walk.schedule.feet, com, state.com_offset)
    sway = Sway(walk.ticks, walk.schedule, com, np.zeros(com.shape), reach)
    return retargeter.walks.check.asked(walk.steps[:1], state, sway)


def test_a_foot_that_swings_far_from_the_hips_asks_for_more(retargeter: Retargeter, state: RetargetState) -> None:
    """The same swing, from one stride behind to one stride ahead: hips that stay behind are far from where it ends."""
    settled(state, (1, 30, 2.0 * STRIDE))
    walk = retargeter.walks.stop(state, 0)
    stance = state.feet[0, :2]
    share = np.clip((walk.ticks - 30) / TICKS, 0.0, 1.0)[:, None]
    along = np.array([1.0, 0.0])
    passing, behind = (
        asked(retargeter, state, walk, stance + (share * (last - first) + first) * along)
        for first, last in ((-0.03, 0.03), (-0.07, -0.07))
    )
    assert behind > 1.1 * passing


def test_feet_are_judged_alike(retargeter: Retargeter, state: RetargetState) -> None:
    settled(state, (1, 30, 2.0 * STRIDE))
    right = retargeter.walks.stop(state, 0)
    share = asked(retargeter, state, right, np.broadcast_to(state.com, (len(right.ticks), 2)))
    mirror = np.array([1.0, -1.0])
    state.feet = state.feet[::-1] * [1.0, -1.0, 1.0, 1.0]
    state.com, state.dcm, state.com_offset = mirror * state.com, mirror * state.dcm, mirror * state.com_offset
    settled(state, (0, 30, 2.0 * STRIDE))
    left = retargeter.walks.stop(state, 0)
    same = asked(retargeter, state, left, np.broadcast_to(state.com, (len(left.ticks), 2)))
    np.testing.assert_allclose(same, share, rtol=1e-6)


def test_a_settled_swing_that_lacks_time_lands_later(retargeter: Retargeter, state: RetargetState) -> None:
    """It was settled for a walk that went on; the robot stops, and its hips stay behind."""
    settled(state, (1, 30, 2.0 * STRIDE))
    step = retargeter.walks.stop(state, 0).steps[0]
    assert (step.side, step.lift) == (1, 30)
    assert TICKS < step.land - step.lift < 1.7 * TICKS


def test_a_foot_in_the_air_keeps_its_landing(retargeter: Retargeter, state: RetargetState) -> None:
    settled(state, (1, 30, 2.0 * STRIDE))
    step = retargeter.walks.stop(state, 40).steps[0]
    assert (step.lift, step.land) == (30, 30 + TICKS)


def test_a_swing_never_takes_the_time_of_the_next_settled_one(retargeter: Retargeter, state: RetargetState) -> None:
    pause = retargeter.footsteps.timing.pause
    settled(state, (1, 30, 2.0 * STRIDE), (0, 30 + TICKS + pause + 3, 2.0 * STRIDE))
    first, second = retargeter.walks.stop(state, 0).steps[:2]
    assert second.lift == 30 + TICKS + pause + 3
    assert first.land <= second.lift - pause
