"""When a sway is answered: of a robot that walks on one foot, measured twice, no wrong reading, not too often."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from flexmotion.streamer.control.ladder import State
from flexmotion.streamer.control.tick_row import TickRow, blank
from flexmotion.streamer.planning.push_watch import PushWatch

RATE = 125
SWAY = (0.03, -0.01)


def row(tick: int, error: tuple[float, float] = SWAY, **fields: object) -> TickRow:
    """A row of a robot that walks on its right foot, `error` from its plan."""
    made = TickRow(blank(TickRow.dtype(joints=2)))
    made.tick[...], made.state[...] = tick, State.STREAMING
    made.dcm_ref[...], made.contact_ref[...] = (0.2, 0.1), (False, True)
    made.dcm[...] = made.dcm_ref + error
    for name, value in fields.items():
        getattr(made, name)[...] = value
    return made


def seen(*rows: TickRow, asked_tick: int = 0, lands_in: int = 30) -> PushWatch:
    watch = PushWatch(RATE)
    for one in rows:
        watch.update(one, asked_tick, lands_in)
    return watch


def test_a_sway_is_answered_once_two_rows_show_it() -> None:
    assert seen(row(100)).sway is None
    found = seen(row(100), row(101)).sway
    assert found is not None
    np.testing.assert_allclose(found, SWAY)


@pytest.mark.parametrize("error", [(0.0, 0.0), (0.021, 0.0), (0.0, -0.021), (0.16, 0.0), (math.nan, 0.0)])
def test_a_small_sway_and_one_that_cannot_be_are_left_alone(error: tuple[float, float]) -> None:
    assert seen(row(100, error), row(101, error)).sway is None


@pytest.mark.parametrize(
    "fields",
    [
        {"contact_ref": (True, True)},
        {"state": State.HOLD},
        {"must_stop": True},
        {"hung": True},
        {"imu_stale": 1},
        {"imu_stale": -1},
        {"stale": (0, 1)},
    ],
)
def test_without_its_conditions_nothing_is_answered(fields: dict[str, Any]) -> None:
    assert seen(row(100, **fields), row(101, **fields)).sway is None


def test_rows_of_readings_that_were_not_believed_are_not_followed() -> None:
    """Held values of a gyro that lies agree with each other for five rows, before it counts as stale."""
    assert seen(row(100), row(101, disbelieved=1), row(102, disbelieved=2), row(103, disbelieved=3)).sway is None
    assert seen(row(100, disbelieved=3), row(101, disbelieved=3), row(102, disbelieved=3)).sway is not None


def test_joints_that_are_read_in_turns_are_known_all_the_same() -> None:
    watch = PushWatch(RATE, 2)
    for tick in (100, 101):
        watch.update(row(tick, stale=(0, 1)), 0, 30)
    assert watch.sway is not None


def test_answers_keep_their_distance() -> None:
    assert seen(row(100), row(101), asked_tick=97).sway is None
    assert seen(row(100), row(101), row(102), asked_tick=97).sway is not None


def test_a_foot_that_has_just_lifted_is_waited_for() -> None:
    """A foot that lands or lifts late sways as far as a push, for some ticks."""
    stands = row(100, contact_ref=(True, True))
    assert seen(stands, *(row(tick) for tick in range(101, 111))).sway is None
    assert seen(stands, *(row(tick) for tick in range(101, 112))).sway is not None


def test_a_foot_that_is_about_to_land_is_left_to_land() -> None:
    """Went wrong: a foot that struck early had a plan made that could move nothing, and a walk lost two steps."""
    assert seen(row(100), row(101), lands_in=17).sway is None
    assert seen(row(100), row(101), lands_in=18).sway is not None


def test_the_same_row_does_not_count_twice() -> None:
    assert seen(row(100), row(100), row(100)).sway is None


@given(
    lies=st.lists(st.tuples(st.floats(-0.5, 0.5), st.floats(-0.5, 0.5)), min_size=1, max_size=40),
    still=st.tuples(st.floats(-0.008, 0.008), st.floats(-0.008, 0.008)),
)
def test_single_lies_are_not_followed(lies: list[tuple[float, float]], still: tuple[float, float]) -> None:
    """Every second row is false, and none of the false ones is believed, whatever it says."""
    watch = PushWatch(RATE)
    for number, lie in enumerate(lies):
        for tick, error in ((2 * number, lie), (2 * number + 1, still)):
            watch.update(row(tick, error), -100, 30)
            assert watch.sway is None
