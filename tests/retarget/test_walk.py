from __future__ import annotations

import numpy as np
import pytest

from flexmotion.human.motion import Motion
from flexmotion.retarget.retargeter import Retargeter
from flexmotion.retarget.state import SETTLED_STEPS, RetargetState
from flexmotion.retarget.steps import UNHURRIED_S, Step, pack_steps

from .conftest import RATE, Views


@pytest.fixture
def state(retargeter: Retargeter) -> RetargetState:
    state = retargeter.layout.view(retargeter.standing())
    state.consumed = 0.0
    return state


def test_the_rows_reach_past_the_last_landing(
    retargeter: Retargeter, state: RetargetState, view: Views, walk: Motion
) -> None:
    walked = retargeter.walks.follow(state, view(walk))
    assert len(walked.steps) == 8
    np.testing.assert_array_equal(walked.ticks, np.arange(len(walked.ticks)))
    last = max(step.land for step in walked.steps)
    assert len(walked.ticks) == max(last, view(walk).end_tick) + round(0.8 * RATE)
    rest = walked.schedule.feet[-1, :, :2].mean(axis=0)
    np.testing.assert_allclose(walked.balance.zmp[-1], rest, atol=1e-9)
    np.testing.assert_allclose(walked.balance.dcm[0], state.dcm, atol=1e-12)


def test_the_hips_stay_low_after_a_walk(
    retargeter: Retargeter, state: RetargetState, view: Views, walk: Motion
) -> None:
    cut = view(walk[:75])
    walking = retargeter.walks.follow(state, cut).schedule.walking
    assert walking[cut.follow :].all()


def test_frames_that_end_before_the_horizon_end_with_the_feet_side_by_side(
    retargeter: Retargeter, state: RetargetState, view: Views, walk: Motion
) -> None:
    whole = view(walk[:60])
    part = type(whole)(**(vars(whole) | {"whole": False}))
    longer, shorter = (retargeter.walks.follow(state, seen).steps for seen in (part, whole))
    assert len(longer) == len(shorter) + 1
    feet = retargeter.body.home_feet.copy()
    for step in longer:
        feet[step.side] = step.target
    assert np.hypot(*(feet[0] - feet[1])[:2]) == pytest.approx(retargeter.body.stand_width, abs=0.015)


def test_a_stop_makes_the_settled_steps_and_no_other(retargeter: Retargeter, state: RetargetState) -> None:
    home = retargeter.body.home_feet
    stopped = retargeter.walks.stop(state, 100)
    assert stopped.steps == [] and stopped.schedule.contacts.all()
    state.position[0] = retargeter.gait.walk_hip_height
    settled = Step(1, 110, 160, home[1].copy(), home[1] + [0.08, 0.0, 0.0, 0.0], 1.0)
    state.steps = pack_steps([settled], SETTLED_STEPS)
    first, last = retargeter.walks.stop(state, 100).steps
    assert (first.side, first.lift, first.land) == (1, 110, 160)
    assert last.side == 0 and last.inserted
    np.testing.assert_allclose(last.target[:2] - first.target[:2], [0.0, retargeter.body.stand_width], atol=1e-9)


def test_a_step_that_would_move_the_weight_too_fast_is_put_off(
    retargeter: Retargeter, state: RetargetState, view: Views, walk: Motion
) -> None:
    """The weight is on its way to the left foot already, or still in the middle when the right foot is to lift soon."""
    now = int(0.9 * RATE)
    state.dcm = [0.0, 0.03]
    soon = retargeter.walks.follow(state, view(walk, now))
    assert soon.steps[0].side == 1 and soon.steps[0].lift == now + round(UNHURRIED_S * RATE)
    assert soon.balance.excess <= 1.0
    state.dcm = 0.0
    later = retargeter.walks.follow(state, view(walk, now))
    assert soon.steps[0].lift + round(0.1 * RATE) <= later.steps[0].lift <= soon.steps[0].lift + round(0.2 * RATE)


def test_the_zero_moment_point_rolls_over_the_sole_of_the_standing_foot(
    retargeter: Retargeter, state: RetargetState, view: Views, walk: Motion
) -> None:
    """From behind its centre to ahead of it, for hips that move evenly; on the centres where the robot stands."""
    walked = retargeter.walks.follow(state, view(walk))
    schedule = walked.schedule
    half = retargeter.robot.sole_half_size[:, 0].min()
    seen = 0
    for step in walked.steps[2:6]:
        rows = (walked.ticks >= step.lift) & (walked.ticks < step.land)
        ahead = walked.balance.zmp[rows, 0] - schedule.feet[rows, step.stance, 0]
        assert ahead[0] < -0.01 and ahead[-1] > 0.01
        assert np.abs(ahead).max() < 0.5 * half
        seen += 1
    assert seen == 4
