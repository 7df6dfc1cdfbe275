"""Plans beyond the envelope: slowed, then made smaller, then refused; eased less where there is room."""

from __future__ import annotations

import copy
from collections.abc import Callable
from typing import cast

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from flexmotion.configs.robot import Robot
from flexmotion.configs.stream import StreamSettings
from flexmotion.human.motion import Motion
from flexmotion.retarget.drafting import DRAFTS, Drafted, best_draft
from flexmotion.retarget.easing import LEAST_PACE, LEAST_SIZE, WHOLE, Ease
from flexmotion.retarget.effort import Effort
from flexmotion.retarget.plan import Plan
from flexmotion.retarget.retargeter import Retargeter

FRAMES, REPLAN = 32, 31


def weak(robot: Robot, share: float) -> Robot:
    """The robot with less torque in every servo."""
    found = copy.copy(robot)
    for name in ("stall_torque", "usable_torque", "back_emf"):
        setattr(found, name, share * getattr(robot, name))
    return found


def judging(robot: Robot, stream: StreamSettings, limit: float | None = 1.0) -> Retargeter:
    return Retargeter(robot, stream.model_copy(update={"effort_limit": limit}))


def follow(retargeter: Retargeter, motion: Motion, most: int = 40) -> list[Plan]:
    """Plans, each resuming the one before, until the motion is over."""
    plans, state, tick = list[Plan](), retargeter.standing(), 0
    while len(plans) < most:
        first = retargeter.next_frame(state, tick, motion.fps)
        frames = motion[first : first + FRAMES]
        if len(frames) < 2:
            break
        plans.append(retargeter.plan(state, frames, first, tick))
        rows = min(REPLAN, len(plans[-1]) - 1)
        state, tick = plans[-1].states[rows], tick + rows
    return plans


@given(load=st.floats(1.001, 10.0))
def test_each_draft_is_slower_or_smaller_down_to_the_least(load: float) -> None:
    ease = WHOLE
    for _ in range(60):
        slower = ease.slower(Effort(load), 1.0)
        assert slower.size == ease.size and (slower.pace < ease.pace or ease.pace == LEAST_PACE)
        ease = slower
    assert ease == Ease(LEAST_PACE, 1.0)
    for _ in range(60):
        smaller = ease.smaller(Effort(load), 1.0)
        assert smaller.pace == ease.pace and (smaller.size < ease.size or ease.size == LEAST_SIZE)
        ease = smaller
    assert ease == Ease(LEAST_PACE, LEAST_SIZE)


def drafted(load_of: Callable[[Ease], float]) -> tuple[Drafted, list[Ease]]:
    """The draft that is kept of plans that need this load, and all that were made."""
    made = list[Ease]()

    def make(ease: Ease) -> tuple[Plan, Effort]:
        made.append(ease)
        return cast(Plan, ease), Effort(load_of(ease))

    return best_draft(make, WHOLE, 1.0), made


def test_a_plan_within_the_limit_is_made_once() -> None:
    best, made = drafted(lambda _ease: 0.99)
    assert made == [WHOLE] and best.ease == WHOLE and best.drafts == 1


def test_a_load_of_motion_is_taken_off_by_a_slower_pace_alone() -> None:
    best, made = drafted(lambda ease: 1.2 * ease.pace**2)
    assert best.effort.load <= 1.0 and best.ease.size == 1.0 and best.first.load == 1.2
    assert len(made) == best.drafts <= DRAFTS


def test_where_a_slower_pace_does_not_help_the_motion_is_made_smaller() -> None:
    best, made = drafted(lambda ease: 1.1 * ease.size)
    assert best.effort.load <= 1.0 and best.ease.pace == 1.0 and best.ease.size < 1.0
    assert [ease.pace < 1.0 for ease in made] == [False, True, False]


def test_where_nothing_helps_nothing_is_eased() -> None:
    best, made = drafted(lambda _ease: 1.5)
    assert best.ease == WHOLE and best.effort.load == 1.5 and len(made) == DRAFTS


def test_eased_less_only_where_there_is_room() -> None:
    eased = Ease(LEAST_PACE, 0.8)
    assert eased.relaxed(Effort(0.95), 1.0) == eased
    larger = eased.relaxed(Effort(0.3), 1.0)
    assert larger.size > 0.8 and larger.pace == LEAST_PACE
    ease = eased
    for _ in range(20):
        ease = ease.relaxed(Effort(0.3), 1.0)
    assert ease == WHOLE and ease.whole


def test_plans_within_the_limit_are_those_that_are_not_judged(
    op3: Robot, stream: StreamSettings, retargeter: Retargeter, walk: Motion
) -> None:
    for plan, free in zip(follow(judging(op3, stream, 5.0), walk, 5), follow(retargeter, walk, 5), strict=True):
        assert plan.eased is not None and plan.eased.ease.whole and plan.eased.drafts == 1
        assert free.eased is None
        np.testing.assert_array_equal(plan.q, free.q)
        np.testing.assert_array_equal(plan.states, free.states)
        assert not plan.repairs["torque"].any()


def test_a_weaker_robot_follows_more_slowly(op3: Robot, stream: StreamSettings, clip: Motion) -> None:
    """The clip waves: the arm of a robot with 70 % of the torque follows it at a slower pace, within its envelope."""
    wave = clip[:100]
    plans = follow(judging(weak(op3, 0.7), stream), wave)
    eased = [plan.eased for plan in plans if plan.eased is not None]
    assert min(one.ease.pace for one in eased) < 1.0
    assert not any(one.refused for one in eased) and max(one.drafts for one in eased) <= DRAFTS
    slowest = min(plans, key=lambda plan: plan.eased.ease.pace if plan.eased else 1.0)
    assert slowest.eased is not None and slowest.repairs["torque"].all()
    known = slowest.source_s[: slowest.stop_row]
    np.testing.assert_allclose(np.diff(known) * op3.rate_hz, slowest.eased.ease.pace, atol=1e-9)
    assert slowest.eased.effort.load < slowest.eased.first.load or slowest.eased.drafts == 1


def test_clock_of_the_human_goes_on_where_it_was_when_the_pace_changes(
    op3: Robot, stream: StreamSettings, clip: Motion
) -> None:
    plans = follow(judging(weak(op3, 0.7), stream), clip[:100])
    for plan, after in zip(plans, plans[1:], strict=False):
        row = after.start_tick - plan.start_tick
        if row < plan.stop_row and after.stop_row:
            assert after.source_s[0] == pytest.approx(plan.source_s[row], abs=1e-6)
            step = np.abs(after.q[0] - plan.q[row - 1]).max() * op3.rate_hz
            assert step < op3.no_load_speed.max()


def test_a_robot_that_can_hardly_stand_refuses_and_stops(op3: Robot, stream: StreamSettings, clip: Motion) -> None:
    retargeter = judging(weak(op3, 0.12), stream)
    plans = follow(retargeter, clip[:60], 12)
    refused = [plan for plan in plans if plan.eased is not None and plan.eased.refused]
    assert refused
    for plan in refused:
        assert plan.eased is not None and plan.eased.effort.load > 1.0
        assert plan.eased.lag > retargeter.allowed_lag
        assert plan.stop_row == 0 and np.isnan(plan.source_s).all()
        assert plan.contacts[-1].all()


def test_a_short_plan_is_made_once_with_the_ease_that_it_begins_with(
    op3: Robot, stream: StreamSettings, clip: Motion
) -> None:
    retargeter = judging(weak(op3, 0.5), stream)
    state = retargeter.standing()
    retargeter.layout.view(state).ease = np.array([0.8, 0.9])
    plan = retargeter.plan(state, clip[:20], 0, 0, horizon=50)
    assert plan.eased is not None and plan.eased.ease == Ease(0.8, 0.9)
    assert plan.eased.drafts == 1 and not plan.eased.refused


def test_a_stop_is_never_judged(op3: Robot, stream: StreamSettings) -> None:
    retargeter = judging(weak(op3, 0.4), stream)
    assert retargeter.plan(retargeter.standing(), None, 0, 0).eased is None
