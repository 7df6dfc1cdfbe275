"""In how many steps a pendulum is captured: by its sole, by one step, by more, or not at all."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from benchmarks.shared.capturability import MOST_STEPS, Walker, steps_to_capture

WALKER = Walker(6.5, 0.4, np.array([0.057, 0.039]), np.array([-0.12, 0.12]), np.array([0.094, 0.145]))
FEET = np.array([[0.0, 0.05, 0.0], [0.0, -0.05, 0.0]])
SHRINK = np.exp(-WALKER.omega * WALKER.step_s)


def steps(x: float, y: float, swing: int | None = None, landing_s: float = 0.2) -> int | None:
    return steps_to_capture(WALKER, np.array([x, y]), FEET, swing, landing_s)


def test_a_stand_needs_no_step_while_the_divergent_component_is_over_its_soles() -> None:
    assert steps(0.0, 0.0) == 0
    assert steps(0.056, -0.088) == 0


def test_beyond_them_a_step_captures_what_the_formula_says() -> None:
    """One step: e^(-wT) of the farthest foothold and its sole, and what the standing sole holds meanwhile."""
    most = SHRINK * (0.12 + 0.057) + (1.0 - SHRINK) * 0.057
    assert steps(0.058, -0.05) == 1
    assert steps(most - 1e-4, -0.05) == 1
    assert steps(most + 1e-4, -0.05) != 1


def test_more_steps_gain_less_and_less_and_then_it_falls() -> None:
    found = [steps(x, -0.05) for x in np.linspace(0.05, 0.09, 400)]
    known = [number for number in found if number is not None]
    assert known == sorted(known) and {0, 1, 2} <= set(known)
    assert found[-1] is None
    # The limit of an infinite number of steps: each takes the foot on by the longest stride.
    limit = 0.057 + 0.12 * SHRINK / (1.0 - SHRINK)
    assert np.linspace(0.05, 0.09, 400)[len(known) - 1] == pytest.approx(limit, abs=3e-4)


def test_on_one_foot_the_robot_can_be_caught_aside_only_where_the_other_foot_can_land() -> None:
    """The left foot swings: it cannot cross the right one."""
    assert steps(0.0, -0.05, swing=0) == 0
    assert steps(0.0, 0.02, swing=0) in (1, 2)
    assert steps(0.0, -0.11, swing=0) is None


def test_a_foot_that_lands_sooner_captures_more() -> None:
    assert steps(0.08, -0.05, swing=0, landing_s=0.4) is None
    assert steps(0.08, -0.05, swing=0, landing_s=0.1) == 1


@given(x=st.floats(-0.2, 0.2), y=st.floats(-0.25, 0.25), yaw=st.floats(-3.0, 3.0), swing=st.sampled_from([None, 0, 1]))
def test_it_is_the_same_wherever_the_robot_looks_and_for_either_side(
    x: float, y: float, yaw: float, swing: int | None
) -> None:
    turn = np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])
    turned = np.column_stack([FEET[:, :2] @ turn.T, np.full(2, yaw)])
    away = 1e-9  # a point on a bound may fall to either side of it
    found = {steps_to_capture(WALKER, turn @ [x + d, y], turned, swing, 0.2) for d in (-away, 0.0, away)}
    assert steps(x, y, swing) in found
    mirrored = None if swing is None else 1 - swing
    assert steps(x, y, swing) in {steps(x + d, -y, mirrored) for d in (-away, 0.0, away)}
    assert all(number is None or number <= MOST_STEPS for number in found)
