from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from flexmotion.human.motion import Motion
from flexmotion.retarget.plan import Plan
from flexmotion.retarget.retargeter import Retargeter
from flexmotion.retarget.state import RetargetState
from flexmotion.retarget.steps import settled_from

from .conftest import RATE, Windows


@pytest.fixture(scope="session")
def bend(walk: Motion) -> Motion:
    """The walk in a curve."""
    turn = Rotation.from_euler("z", np.linspace(0.0, 0.5, len(walk))[:, None])
    root = turn * Rotation.from_quat(walk.root_quaternion, scalar_first=True)
    return replace(walk, root_quaternion=root.as_quat(scalar_first=True), root_position=turn.apply(walk.root_position))


@pytest.fixture(scope="session")
def plan(retargeter: Retargeter, bend: Motion) -> Plan:
    """The first plan of a walk, with all of its steps."""
    return retargeter.plan(retargeter.standing(), bend, 0, 0, horizon=700)


@pytest.fixture(scope="session")
def states(retargeter: Retargeter, plan: Plan) -> RetargetState:
    return retargeter.layout.view(plan.states)


def test_a_state_holds_its_row_and_the_two_before(plan: Plan, states: RetargetState, retargeter: Retargeter) -> None:
    np.testing.assert_array_equal(states.feet, plan.feet)
    np.testing.assert_array_equal(states.com, plan.com[:, :2])
    np.testing.assert_array_equal(states.dcm, plan.dcm)
    for field, values in ((states.q, plan.q), (states.base, plan.base)):
        np.testing.assert_array_equal(field[1:, 0], values[:-1])
        np.testing.assert_array_equal(field[2:, 1], values[:-2])
    start = retargeter.layout.view(retargeter.standing())
    np.testing.assert_array_equal(states.q[0], start.q)
    np.testing.assert_array_equal(states.q[1, 1], start.q[0])


def test_each_row_holds_the_steps_that_are_settled_and_not_landed(plan: Plan, states: RetargetState) -> None:
    settled = settled_from(plan.steps, RATE)
    assert [step.inserted for step in plan.steps].count(False) == 8
    for row in range(0, len(plan), 7):
        expected = [s for s, tick in zip(plan.steps, settled, strict=True) if np.ceil(tick) <= row < s.land]
        assert [(s.side, s.lift, s.land) for s in states[row].steps.steps()] == [
            (s.side, s.lift, s.land) for s in expected
        ]


def test_landings_are_known_from_their_row_on(plan: Plan, states: RetargetState) -> None:
    for step, following in zip(plan.steps, [*plan.steps[1:], None], strict=True):
        end = len(plan) if following is None else following.land
        assert (states.landed[step.land : end] == step.land).all()
        assert (states.stance[step.land : end] == step.stance).all()
        np.testing.assert_array_equal(states[step.land].human_feet[step.side], step.human)


def test_swings_are_used_up_from_when_their_step_is_settled(plan: Plan, states: RetargetState) -> None:
    for step, tick in zip(plan.steps, settled_from(plan.steps, RATE), strict=True):
        row = int(np.ceil(tick))
        assert states[row].consumed[step.side] == step.consumed_s
        assert step.inserted or step.consumed_s > states[row - 1].consumed[step.side]


def test_the_human_is_known_up_to_the_frame_before_the_next_plans_first(
    retargeter: Retargeter, plan: Plan, states: RetargetState, bend: Motion, window: Windows
) -> None:
    """The next plan begins with the frame at or before its join: the detector must not process it twice."""
    whole = window(bend)
    for row in range(100, len(plan), 31):
        first = min(retargeter.next_frame(plan.states[row], row, bend.fps), len(bend) - 1)
        np.testing.assert_array_equal(states[row].yaws, whole.yaws[first - 1])
        np.testing.assert_array_equal(states[row].detector, whole.detector_states[first - 1])
        assert (whole.yaws[first] != whole.yaws[first - 1]).any()


def test_a_stop_keeps_what_is_known_of_the_human(retargeter: Retargeter, plan: Plan, states: RetargetState) -> None:
    stop = retargeter.layout.view(retargeter.plan(plan.states[200], None, 0, 200).states)
    for name in ("source_tick", "heading", "yaws", "detector"):
        np.testing.assert_array_equal(getattr(stop[-1], name), getattr(states[200], name))
    assert np.isnan(stop.human_feet).all()
