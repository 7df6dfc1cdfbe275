from __future__ import annotations

import numpy as np
import pytest

from flexmotion.retarget.steps import Step
from flexmotion.retarget.state import FROZEN_STEPS, StateLayout, pack_steps

LAYOUT = StateLayout(20, 8)
STEPS = [
    Step(0, 100, 150, np.arange(4.0), np.arange(4.0) + 1, 2.5, notice_s=0.45, human=np.array([0.3, -0.1])),
    Step(1, 160, 210, np.arange(4.0) - 1, np.arange(4.0) + 2, 3.5, inserted=True),
    Step(0, 220, 270, np.zeros(4), np.ones(4), 4.5),
]


def assert_equal(one: list[Step], other: list[Step]) -> None:
    assert len(one) == len(other)
    for a, b in zip(one, other, strict=True):
        for field in ("side", "lift", "land", "consumed_s", "inserted", "notice_s"):
            assert getattr(a, field) == getattr(b, field)
        np.testing.assert_array_equal(a.start, b.start)
        np.testing.assert_array_equal(a.target, b.target)
        np.testing.assert_array_equal(a.human, b.human)


@pytest.mark.parametrize("count", range(FROZEN_STEPS + 1))
def test_steps_survive_packing(count: int) -> None:
    """One slot once lost a foot in the air when the other's next step froze: it hung there for good."""
    state = np.zeros(LAYOUT.size)
    LAYOUT.set(state, "steps", pack_steps(STEPS[:count]))
    assert_equal(LAYOUT.steps(state), STEPS[:count])


def test_more_steps_than_fit_are_refused() -> None:
    """The last one was left out without a word, and decided anew by the next plan."""
    with pytest.raises(ValueError, match="4 steps are settled at once, expected at most 3"):
        pack_steps([*STEPS, STEPS[0]])


def test_unpacked_steps_are_no_views_of_the_state() -> None:
    state = np.zeros(LAYOUT.size)
    LAYOUT.set(state, "steps", pack_steps(STEPS[:1]))
    unpacked = LAYOUT.steps(state)
    state[:] = 9.0
    assert_equal(unpacked, STEPS[:1])


def test_fields_do_not_overlap_and_fill_the_vector() -> None:
    state = np.full(LAYOUT.size, np.nan)
    names = ["feet", "com", "dcm", "com_offset", "position", "velocity", "q", "base", "steps", "consumed"]
    names += ["human_feet", "landed", "stance", "source_tick", "heading", "yaws", "detector"]
    for number, name in enumerate(names):
        shape = LAYOUT.get(state, name).shape
        LAYOUT.set(state, name, np.full(shape, float(number)))
    assert np.isfinite(state).all()
    for number, name in enumerate(names):
        assert (LAYOUT.get(state, name) == number).all()


def test_many_states_are_written_row_by_row_or_where_marked() -> None:
    states = np.zeros((5, LAYOUT.size))
    LAYOUT.set(states, "com", np.arange(10.0).reshape(5, 2))
    LAYOUT.set(states, "landed", 7.0, np.arange(5) >= 3)
    np.testing.assert_array_equal(LAYOUT.get(states, "com"), np.arange(10.0).reshape(5, 2))
    assert [LAYOUT.scalar(row, "landed") for row in states] == [0, 0, 0, 7, 7]
    assert LAYOUT.get(states, "q").shape == (5, 2, 20)
