from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from flexmotion.configs.robot import load_robot
from flexmotion.configs.stream import load_stream
from flexmotion.retarget.retargeter import Retargeter
from flexmotion.retarget.schedule import SHIFT_S, Schedule
from flexmotion.retarget.steps import Step
from flexmotion.retarget.swing import Swings

RATE = 125.0
FEET = np.array([[0.0, 0.05, 0.0, 0.0], [0.0, -0.05, 0.0, 0.0]])
LONG_AGO = -1e9


@cache
def swings() -> Swings:
    """Those of OP3."""
    return Retargeter(load_robot("op3"), load_stream()).swings


def step(side: int, lift: int, land: int, x: float = 0.1) -> Step:
    start = FEET[side]
    return Step(side, lift, land, start.copy(), start + [x, 0.0, 0.0, 0.1], 0.0)


def lay_out(steps: list[Step], rows: int = 500, *, landed: float = LONG_AGO, stance: float = 0.0) -> Schedule:
    ticks = np.arange(rows, dtype=float)
    return Schedule.of(FEET, landed, stance, steps, ticks, np.full(rows, 0.5), RATE, swings())


def test_without_steps_both_feet_stay_in_place_and_share_the_load() -> None:
    schedule = lay_out([])
    np.testing.assert_array_equal(schedule.feet, np.broadcast_to(FEET, (500, 2, 4)))
    assert schedule.contacts.all()
    assert (schedule.share == 0.5).all()
    assert not schedule.walking.any()


def test_a_foot_is_in_the_air_from_lift_to_land_and_then_at_its_target() -> None:
    move = step(1, 100, 150)
    schedule = lay_out([move])
    air = np.zeros(500, bool)
    air[100:150] = True
    np.testing.assert_array_equal(schedule.contacts, np.column_stack([np.ones(500, bool), ~air]))
    np.testing.assert_array_equal(schedule.feet[:, 0], np.tile(FEET[0], (500, 1)))
    np.testing.assert_array_equal(schedule.feet[:101, 1], np.tile(FEET[1], (101, 1)))
    np.testing.assert_allclose(schedule.feet[150:, 1], np.tile(move.target, (350, 1)), atol=1e-12)
    assert schedule.feet[100:150, 1, 2].max() == pytest.approx(swings().clearance, rel=0.05)


def test_a_plan_that_starts_in_mid_swing_continues_the_path() -> None:
    move = step(1, 100, 150)
    whole = lay_out([move])
    middle = Schedule.of(
        whole.feet[120], LONG_AGO, 0.0, [move], np.arange(120.0, 300.0), np.full(180, 0.5), RATE, swings()
    )
    np.testing.assert_allclose(middle.feet, whole.feet[120:300], atol=1e-12)
    np.testing.assert_array_equal(middle.contacts, whole.contacts[120:300])


def test_hips_are_low_near_a_step_only() -> None:
    walking = lay_out([step(1, 200, 250)]).walking
    assert walking[200:250].all()
    assert not walking[0] and not walking[-1]
    assert np.count_nonzero(np.diff(walking.astype(int))) == 2


@st.composite
def walks(draw: st.DrawFn) -> list[Step]:
    """Up to four steps of alternating feet, with pauses between them."""
    steps, tick, side = [], draw(st.integers(5, 120)), draw(st.integers(0, 1))
    for _ in range(draw(st.integers(1, 4))):
        land = tick + draw(st.integers(43, 60))
        steps.append(step(side, tick, land))
        tick, side = land + draw(st.integers(10, 90)), 1 - side
    return steps


@given(steps=walks(), quiet=st.floats(0.3, 0.7))
def test_the_stance_foot_has_all_the_load_and_the_load_has_no_jumps(steps: list[Step], quiet: float) -> None:
    rows = steps[-1].land + 200
    ticks = np.arange(rows, dtype=float)
    share = Schedule.of(FEET, LONG_AGO, 0.0, steps, ticks, np.full(rows, quiet), RATE, swings()).share
    assert (share >= 0.0).all() and (share <= 1.0).all()
    for move in steps:
        np.testing.assert_array_equal(share[move.lift : move.land], move.stance)
    assert share[-1] == pytest.approx(quiet)
    # The fastest ramp: from foot to foot in the shortest double support, at 15/8 of its mean speed. A first step with
    # shorter notice than a shift starts in the middle of one.
    pauses = [b.lift - a.land for a, b in zip(steps, steps[1:], strict=False)]
    fastest = 1.875 / min([*pauses, round(SHIFT_S * RATE)])
    assert np.abs(np.diff(share)).max() <= fastest * 1.1


def test_the_load_starts_on_the_stance_foot_of_the_step_before_the_plan() -> None:
    schedule = lay_out([], landed=-5.0, stance=1.0)
    assert 0.9 < schedule.share[0] < 1.0
    assert schedule.share[int(SHIFT_S * RATE)] == pytest.approx(0.5)
    assert (np.diff(schedule.share) <= 1e-12).all()


def test_the_feet_are_copied() -> None:
    feet = FEET.copy()
    schedule = Schedule.of(feet, LONG_AGO, 0.0, [], np.arange(3.0), np.full(3, 0.5), RATE, swings())
    schedule.feet[:] = 7.0
    np.testing.assert_array_equal(feet, FEET)
