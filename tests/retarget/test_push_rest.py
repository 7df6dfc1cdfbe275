"""After a push outward the foot that carries the robot stays down, and the weight comes between the feet."""

from __future__ import annotations

import numpy as np
import pytest

from flexmotion.configs.robot import load_robot
from flexmotion.configs.stream import load_stream
from flexmotion.importers.default_clip import default_clip
from flexmotion.retarget.plan import Plan
from flexmotion.retarget.push_rest import LEAN_M, REST_S, PushRest, outward
from flexmotion.retarget.retargeter import Retargeter
from flexmotion.retarget.steps import Step

RETARGETER = Retargeter(load_robot("op3"), load_stream())
RATE, WIDTH = RETARGETER.rate, RETARGETER.body.stand_width
REST = PushRest(RATE)
LIFT, LAND = 100, 152
HELD = LAND + round(REST_S * RATE)
WALK = default_clip()[225:325]
PLAN: Plan = RETARGETER.plan(RETARGETER.standing(), WALK[:75], 0, 0)


def walking(stance: int, yaw: float = 0.0) -> tuple[list[Step], np.ndarray, np.ndarray]:
    """A foot in the air, the step of the other one after it, the feet, and outward of the one on the ground."""
    away = 1.0 if stance == 0 else -1.0
    aside = away * np.array([-np.sin(yaw), np.cos(yaw)])
    feet = np.zeros((2, 4))
    feet[:, 3] = yaw
    feet[1 - stance, :2] = -WIDTH * aside
    first = Step(1 - stance, LIFT, LAND, feet[1 - stance].copy(), feet[1 - stance].copy(), 1.0)
    then = Step(stance, LAND + 10, LAND + 62, feet[stance].copy(), feet[stance].copy(), 2.0)
    return [first, then], feet, aside


@pytest.mark.parametrize(("stance", "yaw"), [(0, 0.0), (1, 0.0), (0, 0.7), (1, -2.0)])
def test_the_foot_over_whose_edge_the_robot_leans_does_not_lift(stance: int, yaw: float) -> None:
    """Went wrong: pushed outward, the robot stood on the edge of one sole, and the plan lifted that foot on time."""
    steps, feet, aside = walking(stance, yaw)
    found, until = REST.answer(steps, feet, -0.2 * WIDTH * aside, 120, 1.1 * LEAN_M * aside)
    assert found[0] is steps[0]  # the other foot lands when and where it was to
    assert (until, found[1].lift, found[1].land) == (HELD, HELD, HELD + 52)
    # It is settled from now on: the next plan would lift the foot as the human does.
    assert found[1].lift - found[1].notice_s * RATE <= 120
    # Asked again, nothing moves on.
    again, _ = REST.answer(found, feet, -0.2 * WIDTH * aside, 126, 1.1 * LEAN_M * aside)
    assert again is found


def test_both_feet_stay_down_where_both_are_down() -> None:
    steps, feet, aside = walking(stance=0)
    found, until = REST.answer(steps[1:], feet, np.zeros(2), LAND + 4, 0.05 * aside)
    assert until == found[0].lift == LAND + 4 + round(REST_S * RATE)


def test_steps_after_the_one_that_waits_keep_their_distance() -> None:
    steps, feet, aside = walking(stance=1)
    third = Step(0, LAND + 72, LAND + 124, feet[0].copy(), feet[0].copy(), 3.0)
    found, _ = REST.answer([*steps, third], feet, np.zeros(2), 120, 0.05 * aside)
    assert found[2].lift - found[1].land == third.lift - steps[1].land


@pytest.mark.parametrize("error", [0.9 * LEAN_M, 0.0, -0.1, np.nan])
def test_a_small_lean_and_one_inward_are_left_alone(error: float) -> None:
    steps, feet, aside = walking(stance=0)
    found, until = REST.answer(steps, feet, np.zeros(2), 120, error * aside)
    assert found is steps and until == -np.inf


def test_a_robot_on_its_way_to_the_other_foot_goes_on() -> None:
    """Went wrong: pushed ahead, a foot landed late, and the plan threw the robot back over the one it was going to."""
    steps, feet, aside = walking(stance=0)
    assert REST.answer(steps, feet, -0.6 * WIDTH * aside, LAND - 3, 0.05 * aside)[1] > LAND
    assert REST.answer(steps, feet, -0.9 * WIDTH * aside, LAND - 3, 0.05 * aside)[0] is steps


def test_a_step_that_is_not_settled_is_left_alone() -> None:
    steps, feet, aside = walking(stance=0)
    assert REST.answer(steps[:1], feet, np.zeros(2), 120, 0.05 * aside)[0] == steps[:1]
    assert REST.answer([], feet, np.zeros(2), 120, 0.05 * aside)[0] == []


def pushed() -> tuple[Plan, int, int]:
    """A plan after a push outward in the first step of a walk, the foot that stays down, and until when."""
    first, then = PLAN.steps[:2]
    tick = first.land - 8
    state = PLAN.states[tick].copy()
    view = RETARGETER.layout.view(state)
    assert view.steps.steps()[1].lift == then.lift
    side, yaw = then.side, float(view.feet[then.side, 3])
    aside = np.array([-np.sin(yaw), np.cos(yaw)]) * (1.0 if side == 0 else -1.0)
    assert outward(0.05 * aside, side, yaw) == pytest.approx(0.05)
    RETARGETER.rest(view, tick, 0.05 * aside)
    frame = RETARGETER.next_frame(state, tick, WALK.fps)
    return RETARGETER.plan(state, WALK[frame : frame + 40], frame, tick), side, int(view.rests)


def test_the_human_walks_on_and_the_robot_rests() -> None:
    """Went wrong: with both feet down the weight was that of the human, who walks: the robot swayed, and fell."""
    plan, side, until = pushed()
    rows = np.arange(len(plan))
    assert plan.contacts[rows < until - plan.start_tick, side].all()
    middle = plan.load_share[(rows > 0.4 * RATE) & (rows < until - plan.start_tick - 0.3 * RATE)]
    np.testing.assert_allclose(middle, 0.5, atol=1e-6)


def test_plans_during_the_rest_keep_it_and_the_robot_walks_on_after_it() -> None:
    plan, side, until = pushed()
    tick = plan.start_tick + round(0.3 * RATE)
    state = plan.states[tick - plan.start_tick].copy()
    frame = RETARGETER.next_frame(state, tick, WALK.fps)
    later = RETARGETER.plan(state, WALK[frame : frame + 100], frame, tick)
    assert later.steps and later.steps[0].side == side and later.steps[0].lift == until
    assert len(later.steps) > 1
    assert np.abs(later.q[0] - plan.q[tick - plan.start_tick]).max() < 0.01


def test_a_rest_of_nothing_leaves_a_state_as_it_was() -> None:
    tick = PLAN.steps[0].land - 8
    state = PLAN.states[tick].copy()
    RETARGETER.rest(RETARGETER.layout.view(state), tick, np.zeros(2))
    np.testing.assert_array_equal(state, PLAN.states[tick])
