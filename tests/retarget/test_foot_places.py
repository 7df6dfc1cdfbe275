"""Places of feet: what is in reach of a step, and the step that brings a foot there."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from flexmotion.configs.errors import ConfigError, RetargetError
from flexmotion.configs.robot import load_robot
from flexmotion.configs.stream import load_stream
from flexmotion.human.motion import Motion
from flexmotion.retarget.foot_goal import THERE_M, THERE_RAD, FootGoal
from flexmotion.retarget.foot_places import FootPlaces
from flexmotion.retarget.restrictions import Restrictions
from flexmotion.retarget.retargeter import Retargeter
from flexmotion.retarget.steps import UNHURRIED_S

from .conftest import RATE, in_time

ROBOT = load_robot("op3")
PLACES: FootPlaces = Retargeter(ROBOT, load_stream()).foot_places
LEFT, RIGHT = 0, 1
ANYWHERE = st.tuples(st.floats(-0.4, 0.4), st.floats(-0.4, 0.4), st.floats(-1.0, 1.0))
SIDES = st.sampled_from(["left", "right"])


def outward(side: str, left: float) -> float:
    return left if side == "left" else -left


@given(SIDES, ANYWHERE)
def test_the_nearest_place_is_in_reach_itself_and_within_what_the_gait_steps(
    side: str, asked: tuple[float, float, float]
) -> None:
    gait = ROBOT.gait
    found = PLACES.nearest(side, asked[:2], asked[2], 1.0, math.pi)
    again = PLACES.nearest(side, (found.ahead, found.left), found.turn, 0.0, 0.0)
    assert again.moved is None
    assert math.hypot(again.ahead - found.ahead, again.left - found.left) < THERE_M
    toes_out = outward(side, found.turn)
    assert -gait.max_toe_in - 1e-9 <= toes_out <= gait.max_foot_yaw + 1e-9
    # In the frame midway between both feet, in which the gait's limits count.
    cos, sin = math.cos(0.5 * found.turn), math.sin(0.5 * found.turn)
    apart = outward(side, cos * found.left - sin * found.ahead)
    assert gait.lateral[0] - 1e-9 <= apart, "the feet would meet"
    assert apart <= max(gait.lateral[1], gait.lateral[0] + ROBOT.sole_half_size[:, 0].max()) + 1e-9
    if found.moved is None:
        assert math.hypot(found.ahead - asked[0], found.left - asked[1]) <= THERE_M
        assert abs(found.turn - asked[2]) <= THERE_RAD


@given(ANYWHERE)
def test_what_one_foot_reaches_the_other_one_reaches_mirrored(asked: tuple[float, float, float]) -> None:
    left = PLACES.nearest("left", asked[:2], asked[2], 1.0, math.pi)
    right = PLACES.nearest("right", (asked[0], -asked[1]), -asked[2], 1.0, math.pi)
    assert (right.ahead, right.left, right.turn) == pytest.approx((left.ahead, -left.left, -left.turn), abs=1e-9)


def test_a_place_beyond_the_tolerance_is_refused_with_the_nearest_one_and_what_is_in_reach() -> None:
    message = r"nearest place is \[0.120, 0.095\] m, 8.0 cm from there, .* -0.120 to 0.120 m ahead and 0.094 to 0.145 m"
    with pytest.raises(ConfigError, match=message):
        PLACES.nearest("left", (0.2, 0.1), 0.0, 0.05, 0.1)
    with pytest.raises(ConfigError, match=r"right foot; the nearest place is \[0.000, -0.094\] m"):
        PLACES.nearest("right", (0.0, 0.1), 0.0, 0.05, 0.1)
    with pytest.raises(ConfigError, match=r"heading 0.8 rad \(45.84°\), expected -0.4 to 0.5 rad \(.* 28.65°\) for"):
        PLACES.nearest("left", (0.0, 0.13), 0.8, 0.05, 0.1)
    assert PLACES.nearest("right", (0.0, -0.165), 0.0, 0.05, 0.1).moved == "[0.000, -0.145] m, 2.0 cm from there"
    assert PLACES.nearest("left", (0.0, 0.13), 0.55, 0.05, 0.1).moved == "heading 0.5 rad (28.65°)"


@given(st.sampled_from([0, 1]), ANYWHERE, st.tuples(*[st.floats(-3.0, 3.0)] * 3))
def test_a_foot_at_its_place_is_seen_there(
    side: int, place: tuple[float, float, float], stance: tuple[float, float, float]
) -> None:
    goal = FootGoal(side, *place, due=0.0)
    feet = np.zeros((2, 4))
    feet[1 - side] = [stance[0], stance[1], 0.0, stance[2]]
    feet[side] = goal.pose(feet[1 - side])
    away = feet[side] - feet[1 - side]
    assert math.hypot(*away[:2]) == pytest.approx(math.hypot(*place[:2]), abs=1e-9)
    assert goal.is_there(feet)
    feet[side, 0] += 2 * THERE_M
    assert not goal.is_there(feet)


def test_a_goal_that_is_no_number_is_refused() -> None:
    with pytest.raises(RetargetError, match="expected side 0 or 1 and finite numbers"):
        FootGoal(LEFT, 0.0, math.nan, 0.0, 0.0)
    with pytest.raises(RetargetError, match="expected side 0 or 1"):
        FootGoal(2, 0.0, 0.1, 0.0, 0.0)


AHEAD = FootGoal(LEFT, 0.08, 0.1, 0.1, due=125.0)


def test_a_step_lands_when_it_is_due_and_the_robot_stays_there(retargeter: Retargeter) -> None:
    plan = retargeter.plan(retargeter.standing(), None, 0, 0, restrictions=Restrictions(placed=AHEAD))
    (step,) = plan.steps
    assert (step.side, step.land) == (LEFT, 125) and in_time(retargeter.swings, step)
    assert AHEAD.is_there(plan.feet[-1]) and plan.contacts[-1].all()
    assert all(not count.any() for count in plan.repairs.values())
    held = retargeter.plan(plan.states[-1], None, 0, plan.end_tick, restrictions=Restrictions(placed=AHEAD))
    assert not held.steps
    back = retargeter.plan(plan.states[-1], None, 0, plan.end_tick)
    assert [one.side for one in back.steps] == [LEFT]
    left, right = back.feet[-1]
    assert np.hypot(*(left - right)[:2]) == pytest.approx(retargeter.body.stand_width, abs=1e-6)


def test_a_step_that_is_due_too_soon_lands_as_soon_as_it_can_and_one_that_is_due_late_waits(
    retargeter: Retargeter,
) -> None:
    soon, late = (Restrictions(placed=replace(AHEAD, due=due)) for due in (10.0, 500.0))
    plan = retargeter.plan(retargeter.standing(), None, 0, 0, restrictions=soon)
    (step,) = plan.steps
    assert step.lift == round(UNHURRIED_S * RATE) and in_time(retargeter.swings, step)
    assert not retargeter.plan(retargeter.standing(), None, 0, 0, restrictions=late).steps
    (step,) = retargeter.plan(retargeter.standing(), None, 0, 380, restrictions=late).steps
    assert step.land == 500


def test_a_step_is_the_same_in_every_plan_once_it_is_settled(retargeter: Retargeter) -> None:
    """One that is due too soon was put off by each plan that was made before it lifted."""
    restricted = Restrictions(placed=replace(AHEAD, due=10.0))
    plan = retargeter.plan(retargeter.standing(), None, 0, 0, restrictions=restricted)
    for tick in (1, 20, 55, 80, 120):
        again = retargeter.plan(plan.states[tick], None, 0, tick, restrictions=restricted)
        np.testing.assert_allclose(again.feet[: len(plan) - tick], plan.feet[tick:][: len(again)], atol=1e-9)


def test_the_other_foot_may_be_kept_down_and_the_same_foot_may_not(retargeter: Retargeter) -> None:
    for kept, steps in ((RIGHT, 1), (LEFT, 0)):
        restricted = Restrictions(frozenset({kept}), placed=AHEAD)
        assert len(retargeter.plan(retargeter.standing(), None, 0, 0, restrictions=restricted).steps) == steps


def test_a_human_who_walks_makes_no_step_meanwhile(retargeter: Retargeter, walk: Motion) -> None:
    plan = retargeter.plan(retargeter.standing(), walk, 0, 0, restrictions=Restrictions(placed=AHEAD))
    assert plan.withheld > 0 and [step.side for step in plan.steps] == [LEFT]
    assert AHEAD.is_there(plan.feet[-1])


def test_a_stop_leaves_the_feet_astride_where_it_is_told_to(retargeter: Retargeter) -> None:
    goal = replace(AHEAD, due=150.0)
    plan = retargeter.plan(retargeter.standing(), None, 0, 0, restrictions=Restrictions(placed=goal))
    (step,) = plan.steps
    settled = step.lift - round(UNHURRIED_S * RATE)
    for tick in (settled - 20, settled + 5, step.lift + 10, len(plan) - 1):
        stopped = retargeter.plan(plan.states[tick], None, 0, tick, restrictions=Restrictions(astride=True))
        # What is settled or in the air lands; nothing else lifts.
        assert len(stopped.steps) == (settled <= tick < step.lift)
        assert goal.is_there(stopped.feet[-1]) == (tick > settled)
