from __future__ import annotations

import copy

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from flexmotion.drivers.bus.goal_guard import GoalGuard

FIRST = np.array([0])


@pytest.fixture
def guard() -> GoalGuard:
    """Two joints with limits from 1000 to 3000; the servo of the first has limits from 900 to 3100."""
    made = GoalGuard(np.full(2, 1000.0), np.full(2, 3000.0))
    made.limit(0, 900, 3100)
    return made


def seen(guard: GoalGuard, goal: float, standing: float | None = None) -> int:
    """Violations of one goal for the first joint; `standing`: its position, if the goal is pinned."""
    before = guard.violations
    guard.admit(FIRST, np.array([goal]), standing=None if standing is None else np.array([standing]))
    return guard.violations - before


def test_goals_keep_to_the_joints_limits_inside_the_servos(guard: GoalGuard) -> None:
    assert seen(guard, 1000) == 0 and seen(guard, 3000) == 0
    assert seen(guard, 999) == 1 and seen(guard, 3001) == 1


def test_a_pinned_goal_may_be_a_tick_further_out_than_the_joint(guard: GoalGuard) -> None:
    assert seen(guard, 3051, standing=3050) == 0
    assert seen(guard, 3053, standing=3051) == 1


def test_after_a_pin_goals_may_only_move_inside(guard: GoalGuard) -> None:
    seen(guard, 950, standing=950)
    assert [seen(guard, goal) for goal in (950, 960, 955, 990, 1500, 999)] == [0, 0, 1, 0, 0, 1]


def test_no_goal_exceeds_the_servos_own_limits(guard: GoalGuard) -> None:
    assert seen(guard, 899, standing=899) == 1
    guard.limit(1, 900, 3100, current=300)
    guard.admit(np.array([1]), np.array([2000.0]), np.array([301.0]))
    assert guard.violations == 2


def test_a_goal_outside_is_replaced_by_the_one_before(guard: GoalGuard) -> None:
    """Regression: such goals were sent, and counted afterwards."""
    assert guard.admit(FIRST, np.array([3050.0]), standing=np.array([3050.0])) == 3050
    assert guard.admit(FIRST, np.array([3060.0])) == 3050
    assert guard.admit(FIRST, np.array([2990.0])) == 2990
    assert guard.admit(FIRST, np.array([9999.0])) == 2990
    assert guard.violations == 2
    np.testing.assert_array_equal(guard.nearest(np.array([3050.0, 200.0])), [3000, 1000])


GOAL = st.sampled_from([899, 900, 950, 999, 1000, 2000, 3000, 3001, 3050, 3100, 3101])


@given(
    goals=st.lists(st.tuples(GOAL, GOAL, st.integers(-310, 310)), min_size=1, max_size=8),
    pinned=st.sampled_from([950.0, 2000.0, 3080.0]),
)
def test_what_is_admitted_the_short_way_would_be_admitted_unchanged(
    goals: list[tuple[int, int, int]], pinned: float
) -> None:
    made = GoalGuard(np.full(2, 1000.0), np.full(2, 3000.0))
    made.limit(0, 900, 3100, current=300)
    both, slots = np.array([0, 1]), (0, 1)
    made.admit(both, np.full(2, pinned), standing=np.full(2, pinned))
    for first, second, current in goals:
        other = copy.deepcopy(made)
        position, currents = np.array([first, second], np.float64), np.array([current, 0.0])
        if made.admits(slots, (first, second), (current, 0)):
            np.testing.assert_array_equal(other.admit(both, position, currents), position)
            assert other.violations == made.violations
        else:
            np.testing.assert_array_equal(made.last, other.last)
            made.admit(both, position, currents)
            other.admit(both, position, currents)
        np.testing.assert_array_equal(made.last, other.last)
