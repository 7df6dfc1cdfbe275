from __future__ import annotations

import numpy as np
import pytest

from flexmotion.human.contacts import ContactDetector
from flexmotion.retarget.state import SETTLED_STEPS, RetargetState, StateLayout
from flexmotion.retarget.steps import pack_steps

from .test_steps import STEPS, assert_equal

LAYOUT = StateLayout(20, 12)
ORDER = ["feet", "human_feet", "com", "dcm", "com_offset", "position", "velocity", "q", "base", "steps", "consumed"]
ORDER += ["landed", "stance", "source_tick", "heading", "yaws", "detector", "ease", "drift"]
ORDER += ["part", "part_from", "part_speed", "part_to", "part_begins", "part_due", "part_until", "part_bound"]
ORDER += ["planted", "tension", "asked_tension", "placed", "astride", "part_back", "upright"]


def test_fields_fill_the_vector_in_the_order_that_logs_were_written_with() -> None:
    vector = np.arange(float(LAYOUT.size))
    read = [np.asarray(value).view(np.float64).ravel() for _, value in LAYOUT.view(vector)]
    assert list(RetargetState.names()) == ORDER
    np.testing.assert_array_equal(np.concatenate(read), vector)
    assert LAYOUT.size == 193 + SETTLED_STEPS * 11 + 9 * 12 + 3


def test_many_states_are_written_row_by_row_or_where_marked() -> None:
    vectors = np.zeros((5, LAYOUT.size))
    states = LAYOUT.view(vectors)
    states.com = np.arange(10.0).reshape(5, 2)
    states.landed[np.arange(5) >= 3] = 7.0
    np.testing.assert_array_equal(LAYOUT.view(vectors).com, np.arange(10.0).reshape(5, 2))
    assert [float(LAYOUT.view(row).landed) for row in vectors] == [0, 0, 0, 7, 7]
    assert states.q.shape == (5, 2, 20)


def test_steps_of_many_states_are_written_where_marked() -> None:
    vectors = np.zeros((4, LAYOUT.size))
    states = LAYOUT.view(vectors)
    states.steps = pack_steps([], SETTLED_STEPS)
    states.steps[np.arange(4) >= 2] = pack_steps(STEPS[:2], SETTLED_STEPS)
    for row, vector in enumerate(vectors):
        assert_equal(LAYOUT.view(vector).steps.steps(), STEPS[:2] if row >= 2 else [])


def test_a_vector_of_another_robot_is_refused() -> None:
    with pytest.raises(ValueError, match=f"takes {LAYOUT.size} float64, got {LAYOUT.size + 1}"):
        LAYOUT.view(np.zeros(LAYOUT.size + 1))


def test_the_initial_state_knows_of_no_human_and_no_step() -> None:
    state = LAYOUT.view(LAYOUT.initial())
    assert state.steps.steps() == []
    assert np.isnan([float(state.source_tick), float(state.heading)]).all()
    assert np.isnan(state.yaws).all() and np.isnan(state.human_feet).all()
    assert (state.consumed == -np.inf).all()
    np.testing.assert_array_equal(state.detector, ContactDetector().initial())
    assert (state.placed == -1.0).all() and state.astride == 0.0
