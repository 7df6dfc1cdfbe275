"""Joints of arms and head on their way to goals: in time, within the bounds, the same in every later plan, and back."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from flexmotion.configs.errors import RetargetError
from flexmotion.human.motion import Motion
from flexmotion.retarget.easing import Ease
from flexmotion.retarget.part_paths import LONGEST_FADE_S, STOPPED_PARTS, PartGoal, PartGoals
from flexmotion.retarget.plan import Plan
from flexmotion.retarget.retargeter import Retargeter
from flexmotion.retarget.whole_body import POSTURE

RATE = 125
LEFT = np.arange(3) + len(POSTURE)
GOAL = np.array([-0.8, 0.4, -0.9])
"""Left arm raised in front [rad]."""


def goal(due: float, until: float = np.inf, number: int = 7, angles: np.ndarray = GOAL) -> PartGoal:
    return PartGoal(number, LEFT, angles, due, until)


def arm(retargeter: Retargeter, q: np.ndarray) -> np.ndarray:
    found: np.ndarray = q[..., retargeter.body.upper.joints[LEFT - len(POSTURE)]]
    return found


def stands(retargeter: Retargeter, *goals: PartGoal, after: Plan | None = None, join: int = 30) -> Plan:
    """A plan of a robot that stands, from the stand pose or from a row of another plan."""
    if after is None:
        return retargeter.plan(retargeter.standing(), None, 0, 0, parts=PartGoals(goals))
    return retargeter.plan(after.states[join], None, 0, after.start_tick + join, parts=PartGoals(goals))


def test_the_joints_are_there_when_they_are_due_and_stay(retargeter: Retargeter) -> None:
    plan = stands(retargeter, goal(75.0))
    q = arm(retargeter, plan.q)
    assert q[74:] == pytest.approx(np.broadcast_to(GOAL, q[74:].shape), abs=1e-3)
    assert np.abs(q[60] - GOAL).max() > 0.02
    others = np.delete(plan.q, retargeter.body.upper.joints[:3], axis=1)
    assert np.abs(others - others[0])[:, :5].max() < 1e-9  # other arm and head stay


def test_a_later_plan_goes_on_with_the_same_path(retargeter: Retargeter) -> None:
    first = stands(retargeter, goal(90.0))
    again = stands(retargeter, goal(90.0), after=first, join=37)
    rows = min(len(first) - 37, len(again))
    assert arm(retargeter, again.q[:rows]) == pytest.approx(arm(retargeter, first.q[37 : 37 + rows]), abs=1e-9)


@pytest.mark.parametrize("asked", [0.0, 20.0, 40.0])
def test_a_path_that_would_be_too_fast_is_as_late_as_the_bounds_need(retargeter: Retargeter, asked: float) -> None:
    far = np.array([1.2, 0.2, 1.0])
    plan = stands(retargeter, goal(asked, angles=far))
    follower, due = retargeter.follower, float(retargeter.layout.view(plan.states[0].copy()).part_due[LEFT[0]])
    speed = np.gradient(arm(retargeter, plan.q), 1.0 / RATE, axis=0)
    assert due > asked and np.abs(speed).max() <= follower.speed[LEFT].max()
    acceleration = np.gradient(speed[2:-2], 1.0 / RATE, axis=0)
    assert np.abs(acceleration).max() <= follower.acceleration[LEFT].max() * 1.02
    row = min(int(np.ceil(due)), len(plan) - 1)
    assert arm(retargeter, plan.q)[row] == pytest.approx(far, abs=0.02)


def test_a_path_is_hardly_later_than_the_bounds_need(retargeter: Retargeter) -> None:
    """A path that was tried in steps of 5 % came up to 50 ms later than it could: 3 cm of a hand at its fastest."""

    def due(asked: float) -> float:
        plan = stands(retargeter, goal(asked, angles=np.array([1.2, 0.2, 1.0])))
        return float(retargeter.layout.view(plan.states[0].copy()).part_due[LEFT[0]])

    for asked in (20.0, 21.0, 22.3):
        least = due(asked)
        assert due(0.99 * least) > 0.99 * least


def test_a_new_goal_begins_where_the_arm_is_and_moves(retargeter: Retargeter) -> None:
    first = stands(retargeter, goal(70.0))
    turned = stands(retargeter, goal(110.0, number=8, angles=np.array([0.5, 1.0, 0.0])), after=first, join=35)
    q = np.concatenate([arm(retargeter, first.q[:35]), arm(retargeter, turned.q)])
    assert np.abs(np.diff(q, 2, axis=0)).max() * RATE**2 <= retargeter.follower.acceleration[LEFT].max() * 1.02
    assert q[110:] == pytest.approx(np.broadcast_to([0.5, 1.0, 0.0], q[110:].shape), abs=2e-3)


@pytest.mark.parametrize("how", ["its time is over", "it is no goal any more"])
def test_a_robot_that_stands_brings_an_arm_back_to_the_stand_pose(retargeter: Retargeter, how: str) -> None:
    until = 80.0 if how == "its time is over" else np.inf
    plan = stands(retargeter, goal(60.0, until))
    for _ in range(8):
        begin = plan.start_tick + 50
        kept = [goal(60.0, until)] if begin < 80 or how == "its time is over" else []
        plan = stands(retargeter, *kept, after=plan, join=50)
    assert plan.start_tick > 80 + LONGEST_FADE_S * RATE
    home = retargeter.robot.stand_pose[retargeter.body.upper.joints[:3]]
    assert arm(retargeter, plan.q)[-1] == pytest.approx(home, abs=2e-3)
    assert not retargeter.parts.moves(retargeter.layout.view(plan.states[0].copy()), plan.end_tick)


def test_an_arm_goes_back_to_the_human_where_one_is_followed(retargeter: Retargeter, walk: Motion) -> None:
    """The other arm, the legs and the way are those of a plan without a goal."""
    plans = {}
    for name, goals in (("with", [goal(60.0, 70.0)]), ("without", [])):
        plan = retargeter.plan(retargeter.standing(), walk[:32], 0, 0, parts=PartGoals(goals))
        for _ in range(6):
            state, tick = plan.states[31], plan.start_tick + 31
            first = retargeter.next_frame(state, tick, walk.fps)
            plan = retargeter.plan(state, walk[first : first + 32], first, tick, parts=PartGoals(goals))
        plans[name] = plan
    led, free = plans["with"], plans["without"]
    rows = slice(0, min(led.stop_row, free.stop_row))
    assert np.abs(arm(retargeter, led.q[rows]) - arm(retargeter, free.q[rows])).max() < 0.1
    assert led.feet[rows] == pytest.approx(free.feet[rows], abs=1e-6)


def test_a_stop_leaves_the_arm_where_it_is(retargeter: Retargeter) -> None:
    moving = stands(retargeter, goal(70.0))
    stop = retargeter.plan(moving.states[30], None, 0, 30, parts=STOPPED_PARTS)
    q = arm(retargeter, stop.q)
    assert np.abs(q[-1] - arm(retargeter, moving.q)[30]).max() < 0.2
    assert np.abs(np.diff(q[-10:], axis=0)).max() < 1e-4
    assert not retargeter.parts.moves(retargeter.layout.view(stop.states[0].copy()), 40)


def test_a_path_keeps_its_time_where_the_human_is_slowed(retargeter: Retargeter, walk: Motion) -> None:
    """An eased plan lowered the filter's bounds for all channels: the hand was later than its target was answered."""
    vector = retargeter.standing()
    retargeter.layout.view(vector).ease[...] = 0.6, 1.0
    plan = retargeter._draft(
        vector,
        walk[:32],
        0,
        Ease(0.6, 1.0),
        tick=0,
        horizon=None,
        exact=False,
        parts=PartGoals([goal(1.0, angles=np.array([1.2, 0.2, 1.0]))]),
        checkpoint=lambda: None,
    )
    due = float(retargeter.layout.view(plan.states[0].copy()).part_due[LEFT[0]])
    assert 1.0 < due < len(plan) - 1
    assert arm(retargeter, plan.q)[int(np.ceil(due))] == pytest.approx([1.2, 0.2, 1.0], abs=0.02)


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"angles": np.array([0.1, np.nan, 0.2])}, "goal 7: angles: expected 3 finite numbers .*found 0.1, nan, 0.2"),
        ({"angles": np.array([0.1, np.inf, 0.2])}, "goal 7: angles: expected 3 finite numbers"),
        ({"angles": np.zeros(2)}, "goal 7: angles: expected 3 finite numbers"),
        ({"due": np.nan}, "goal 7: expected a finite tick due"),
        ({"until": 10.0}, "goal 7: expected a finite tick due.*found 60 and 10"),
    ],
)
def test_a_goal_without_numbers_is_refused_where_it_is_made(fields: dict[str, Any], message: str) -> None:
    """A goal that is no number was found in the finished plan, which ended the planner."""
    with pytest.raises(RetargetError, match=message):
        PartGoal(**{"number": 7, "channels": LEFT, "angles": GOAL, "due": 60.0, "until": np.inf, **fields})


TRUNK = np.arange(len(POSTURE))
LOW = np.array([0.14, 0.1, 0.3, 0.0])


def bends(due: float, until: float = np.inf, angles: np.ndarray = LOW, back_s: float = 0.0) -> PartGoal:
    return PartGoal(9, TRUNK, angles, due, until, back_s=back_s)


def trunk(retargeter: Retargeter, plan: Plan) -> np.ndarray:
    """Posture over the rows of a plan, from the second row on, (T, 4)."""
    found: np.ndarray = retargeter.layout.view(plan.states).position[1:, TRUNK]
    return found


def test_hips_and_trunk_are_there_when_they_are_due_and_no_foot_lifts_meanwhile(retargeter: Retargeter) -> None:
    plan = stands(retargeter, bends(90.0))
    assert trunk(retargeter, plan)[90] == pytest.approx(LOW, abs=1e-3)
    state = retargeter.layout.view(plan.states[95].copy())
    assert np.isposinf(float(state.upright)) and not plan.steps and plan.contacts.all()


@pytest.mark.parametrize(("back_s", "least", "most"), [(0.0, 0.18, 0.204), (1.8, 0.14, 0.165)])
def test_they_rise_after_their_time_as_slowly_as_is_asked_and_feet_wait_for_it(
    retargeter: Retargeter, back_s: float, least: float, most: float
) -> None:
    down = stands(retargeter, bends(75.0, until=80.0, back_s=back_s))
    rise = stands(retargeter, after=down, join=80)
    assert least < trunk(retargeter, rise)[95][0] < most
    upright = float(retargeter.layout.view(rise.states[0].copy()).upright)
    assert upright == pytest.approx(80.0 + max(back_s, 0.8) * RATE, abs=1.0)


def test_a_stop_on_the_way_brings_the_trunk_to_rest_where_it_is_and_a_later_plan_lets_it_rise(
    retargeter: Retargeter,
) -> None:
    """A stop raised the robot to its stand within half a second."""
    down = stands(retargeter, bends(120.0))
    stop = retargeter.plan(down.states[60], None, 0, 60, parts=STOPPED_PARTS)
    path, before = trunk(retargeter, stop), retargeter.layout.view(down.states[60].copy()).position[TRUNK]
    assert np.abs(path[-1] - before).max() < 0.08 and path[-1][0] < before[0]
    assert np.abs(np.diff(path[40:], axis=0)).max() < 1e-4
    height = path[:, 0]
    assert (np.diff(height) < 1e-4).all(), "it does not turn back"
    stays = retargeter.plan(stop.states[90], None, 0, 150, parts=PartGoals(halts=True))
    assert trunk(retargeter, stays)[-1] == pytest.approx(path[-1], abs=1e-3)
    rises = stands(retargeter, after=stays, join=30)
    assert trunk(retargeter, rises)[-1][0] > path[-1][0] + 0.01


def test_a_stop_just_before_the_goal_arrives_there(retargeter: Retargeter) -> None:
    down = stands(retargeter, bends(90.0))
    stop = retargeter.plan(down.states[80], None, 0, 80, parts=STOPPED_PARTS)
    assert trunk(retargeter, stop)[-1] == pytest.approx(LOW, abs=1e-3)


def test_a_goal_whose_angles_change_is_gone_on_to_from_where_it_was(retargeter: Retargeter) -> None:
    first = stands(retargeter, bends(80.0))
    moved = LOW + [0.01, 0.0, -0.05, 0.0]
    again = stands(retargeter, bends(150.0, angles=moved), after=first, join=90)
    path = trunk(retargeter, again)
    assert path[0] == pytest.approx(LOW, abs=2e-3) and path[70] == pytest.approx(moved, abs=1e-3)


def test_a_trunk_whose_way_back_was_judged_to_need_3_s_takes_them(retargeter: Retargeter) -> None:
    """It was cut to 2.1 s, the longest that an arm takes."""
    bent = np.array([0.15, 0.0, 0.2, 0.0])
    trunk = PartGoal(7, np.arange(4), bent, 60.0, 80.0, back_s=3.0)
    state = retargeter.layout.view(stands(retargeter, trunk).states[0].copy())
    assert retargeter.parts.upright(state, 100.0) == pytest.approx(80.0 + 3.0 * RATE)


def test_torques_are_found_row_by_row_while_an_arm_is_on_its_way(
    retargeter: Retargeter, walk: Motion, monkeypatch: pytest.MonkeyPatch
) -> None:
    """At rest every fourth row is enough; an arm that moves, and a foot that is still to land, are no rest."""
    quiet: list[int] = []
    of = retargeter.torques.of

    def spy(*given: Any) -> Any:
        quiet.append(given[-1])
        return of(*given)

    monkeypatch.setattr(retargeter.torques, "of", spy)
    still = retargeter.plan(retargeter.standing(), None, 0, 0)
    assert quiet[-1] < len(still)
    moves = retargeter.plan(
        retargeter.standing(), None, 0, 0, parts=PartGoals([goal(1.0, angles=np.array([1.2, 0.2, 1.0]))])
    )
    assert quiet[-1] == len(moves)
    before = retargeter.plan(retargeter.standing(), walk[:32], 0, 0)
    steps = retargeter.plan(before.states[100], walk[24:56], 24, 100)
    assert steps.steps and quiet[-1] + 100 > max(step.land for step in steps.steps)
