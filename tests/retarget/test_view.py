from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from flexmotion.human.motion import Motion
from flexmotion.retarget.retargeter import Retargeter
from flexmotion.retarget.state import RetargetState
from flexmotion.retarget.steps import Step, pack_steps
from flexmotion.retarget.view import HumanView, begin_human, follow_drift, forget_human, view_human

from .conftest import RATE

HORIZON = 100


@pytest.fixture
def state(retargeter: Retargeter) -> RetargetState:
    return retargeter.layout.view(retargeter.standing())


def look(state: RetargetState, motion: Motion | None, first_frame: int = 0, tick: int = 0) -> HumanView | None:
    return view_human(
        state, motion, first_frame, tick, horizon=HORIZON, lead_in_s=0.4, leg_length=0.22, rate_hz=float(RATE)
    )


def test_the_first_frames_set_clock_heading_and_feet(state: RetargetState, stand: Callable[..., Motion]) -> None:
    human = stand(40)
    human = replace(human, root_quaternion=np.tile(Rotation.from_euler("z", 1.0).as_quat(scalar_first=True), (40, 1)))
    view = look(state, human, first_frame=6, tick=1000)
    assert view is not None
    assert view.source_tick == state.source_tick == 1000 + round((0.4 - 6 / 30) * RATE)
    assert view.scaling.heading == state.heading == pytest.approx(-1.0, abs=0.05)
    np.testing.assert_array_equal(state.human_feet, view.window.feet[0, :, :2])
    np.testing.assert_array_equal(state.consumed, 6 / 30)
    assert view.first_frame == 6


def test_later_frames_change_neither_clock_nor_heading(state: RetargetState, walk: Motion) -> None:
    look(state, walk[:32])
    before = state.copy()
    view = look(state, walk[10:42], first_frame=10, tick=90)
    assert view is not None and view.source_tick == before.source_tick
    assert state.array.tobytes() == before.array.tobytes()


def test_rows_follow_as_far_as_the_frames_reach_and_the_horizon_allows(
    state: RetargetState, stand: Callable[..., Motion]
) -> None:
    short = look(state, stand(8))
    assert short is not None and not short.whole
    assert short.end_tick == short.follow == short.tick_at(7 / 30) + 1
    long = look(state, stand(60))
    assert long is not None and long.whole and long.follow == HORIZON


def test_ticks_and_source_time_are_each_others_inverse(state: RetargetState, walk: Motion) -> None:
    view = look(state, walk, tick=500)
    assert view is not None
    for tick in (500, 613):
        assert view.tick_at(view.second_at(tick)) == tick
    np.testing.assert_array_equal(view.seconds(np.array([500.0, 613.0])), [view.second_at(500), view.second_at(613)])


@pytest.mark.parametrize("frames", [None, 0, 1])
def test_too_few_frames_are_not_followed(state: RetargetState, walk: Motion, frames: int | None) -> None:
    before = state.copy()
    assert look(state, None if frames is None else walk[:frames]) is None
    assert state.array.tobytes() == before.array.tobytes()


def test_frames_that_are_over_are_not_followed(state: RetargetState, walk: Motion) -> None:
    look(state, walk[:32])
    assert look(state, walk[:32], tick=300) is None


def test_after_a_stop_the_feet_represent_none_of_the_humans(state: RetargetState, walk: Motion) -> None:
    look(state, walk)
    step = Step(0, 10, 60, np.zeros(4), np.ones(4), 1.0, human=np.ones(2))
    state.steps[:1] = pack_steps([step])
    forget_human(state)
    assert np.isnan(state.human_feet).all()
    (kept,) = state.steps.steps()
    assert np.isnan(kept.human).all()
    assert (kept.side, kept.lift, kept.land, kept.consumed_s) == (0, 10, 60, 1.0)


def test_the_heading_takes_back_what_the_robot_turned_beyond_its_plans(state: RetargetState, walk: Motion) -> None:
    look(state, walk)
    begun = float(state.heading)
    for drift, heading in ((0.3, begun), (0.35, begun - 0.05), (np.nan, begun - 0.05), (0.25, begun + 0.05)):
        follow_drift(state, drift)  # the first one is only where it counts from
        assert float(state.heading) == pytest.approx(heading)


def test_a_robot_that_was_turned_by_hands_goes_on_from_there(state: RetargetState, walk: Motion) -> None:
    look(state, walk)
    begun = float(state.heading)
    for drift in (0.0, 1.5, 1.52):
        follow_drift(state, drift)
    assert float(state.heading) == pytest.approx(begun - 0.02)
    begin_human(state)
    follow_drift(state, 0.7)
    assert np.isnan(float(state.heading)) and float(state.drift) == 0.7
