from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from flexmotion.human.body import Body
from flexmotion.human.motion import Motion
from flexmotion.importers.default_clip import build_clip
from flexmotion.retarget.footsteps import EXACT_YAW, FeetState
from flexmotion.retarget.retargeter import Retargeter
from flexmotion.retarget.steps import NOTICE_S, UNHURRIED_S, Step

from .conftest import RATE, Views, Windows, in_time, step_script

Planned = Callable[..., list[Step]]


@pytest.fixture
def plan(retargeter: Retargeter, view: Views) -> Planned:
    """Function motion -> steps of a robot that has been standing; keywords as of `FeetState`, `view` and `put_off`."""

    def make(motion: Motion, *, now: int = 0, put_off: int = 0, **changed: Any) -> list[Step]:
        start: dict[str, Any] = {
            "feet": retargeter.body.home_feet,
            "human_feet": np.full((2, 2), np.nan),
            "consumed": np.full(2, -np.inf),
            "free": np.zeros(2),
            "settled": [],
            "at_rest": True,
        }
        return retargeter.footsteps.plan(view(motion, now), FeetState(**(start | changed)), put_off)

    return make


def test_a_walk_gives_its_steps_foot_by_foot(plan: Planned, walk: Motion) -> None:
    steps = plan(walk)
    assert [step.side for step in steps] == [1, 0, 1, 0, 1, 0, 1, 0]
    assert not any(step.inserted or step.dropped for step in steps)
    for step, lift_s in zip(steps, 1.06 + 0.5 * np.arange(8), strict=True):
        assert step.lift / RATE == pytest.approx(lift_s, abs=0.2)


def test_steps_keep_to_the_gait_limits(plan: Planned, walk: Motion, retargeter: Retargeter) -> None:
    gait, feet = retargeter.gait, retargeter.body.home_feet.copy()
    before = -np.inf
    for step in plan(walk):
        np.testing.assert_array_equal(step.start, feet[step.side])
        assert step.land - step.lift >= retargeter.swings.least_s * RATE - 1
        assert step.lift - before >= gait.double_support_min_s * RATE - 1e-9
        stance = feet[step.stance]
        assert abs(step.target[0] - stance[0]) <= retargeter.swings.stride((step.land - step.lift) / RATE) + 1e-9
        apart = (step.target[1] - stance[1]) * (1 if step.side == 0 else -1)
        assert gait.lateral[0] - 1e-9 <= apart <= gait.lateral[1] + 1e-9
        assert in_time(retargeter.swings, step)
        feet[step.side], before = step.target, step.land


def test_a_shuffle_and_a_stand_give_none(plan: Planned, shuffle: Motion, stand: Callable[..., Motion]) -> None:
    assert plan(shuffle) == []
    assert plan(stand(90)) == []


def test_no_step_is_decided_on_shorter_notice(plan: Planned, walk: Motion) -> None:
    for now in range(0, 5 * RATE, 17):
        for at_rest in (True, False):
            steps = plan(walk, now=now, at_rest=at_rest)
            assert all(step.lift >= now + NOTICE_S * RATE - 1 for step in steps)
            if at_rest and steps:
                assert steps[0].lift >= now + UNHURRIED_S * RATE - 1


@pytest.mark.parametrize("at_rest", [True, False])
def test_inserted_steps_are_never_hurried(plan: Planned, spin: Motion, at_rest: bool) -> None:
    """A step that each plan inserted or left out again, .25 s ahead, made the weight oscillate."""
    seen = 0
    for now in range(0, 4 * RATE, 17):
        for step in plan(spin, now=now, at_rest=at_rest):
            seen += step.inserted
            assert not step.inserted or step.lift >= now + UNHURRIED_S * RATE - 1
            assert not step.inserted or step.notice_s == UNHURRIED_S
    assert seen > 20


def test_a_step_that_would_be_too_late_is_left_out_and_counted(plan: Planned, walk: Motion) -> None:
    steps = plan(walk, now=int(2.2 * RATE))
    assert steps[0].dropped >= 1
    assert len(steps) + sum(step.dropped for step in steps) == 8


def test_settled_steps_are_kept_unchanged(plan: Planned, walk: Motion) -> None:
    planned = plan(walk)
    again = plan(walk, settled=planned[:2], now=planned[0].lift + 5)
    assert again[:2] == planned[:2]
    assert again[2].side == planned[2].side
    np.testing.assert_array_equal(again[2].start, planned[0].target)
    assert again[2].lift >= planned[1].land


def test_a_swing_that_is_used_up_gives_no_second_step(plan: Planned, walk: Motion) -> None:
    planned = plan(walk)
    consumed = np.array([planned[1].consumed_s, planned[0].consumed_s])
    rest = plan(walk, consumed=consumed)
    assert [round(s.consumed_s, 6) for s in rest] == [round(s.consumed_s, 6) for s in planned[2:]]


@pytest.mark.parametrize("later_s", [0.01, 0.04])
def test_a_swing_that_lands_later_in_the_next_window_is_not_a_second_step(
    plan: Planned, walk: Motion, later_s: float
) -> None:
    """The foot of a settled step landed 40 ms later in the next window: it stepped twice, and the robot fell."""
    planned = plan(walk)
    consumed = np.array([-np.inf, planned[0].consumed_s - later_s])
    again = plan(walk, consumed=consumed, settled=[planned[0]], now=planned[0].lift - 10)
    assert [step.side for step in again] == [step.side for step in planned]


def test_a_swing_whose_landing_is_in_the_next_window_is_not_a_second_step(plan: Planned, walk: Motion) -> None:
    """The first window ends in mid-swing, as that of a short plan does; the next one contains the landing."""
    (early,) = plan(walk[:42])
    assert early.consumed_s == pytest.approx(early.land / RATE, abs=0.01)
    consumed = np.array([-np.inf, early.consumed_s])
    again = plan(walk, consumed=consumed, settled=[early], now=early.lift - 10)
    assert [step.side for step in again] == [1, 0, 1, 0, 1, 0, 1, 0]


def test_a_step_may_be_put_off(plan: Planned, walk: Motion) -> None:
    now = int(0.9 * RATE)
    soon, later = plan(walk, now=now), plan(walk, now=now, put_off=12)
    assert later[0].side == soon[0].side and later[0].lift == soon[0].lift + 12
    settled = plan(walk, now=now + 60, settled=[soon[0]], put_off=12)
    assert settled[0] is soon[0]


def test_start_poses_are_copies_of_the_feet(plan: Planned, walk: Motion, spin: Motion, retargeter: Retargeter) -> None:
    """A start that was a view of the planner's feet was overwritten by the target: the foot jumped at lift-off."""
    feet = retargeter.body.home_feet.copy()
    for motion in (walk, spin):
        steps = plan(motion, feet=feet)
        np.testing.assert_array_equal(feet, retargeter.body.home_feet)
        for step in steps:
            assert not np.shares_memory(step.start, feet)
            assert not np.shares_memory(step.start, step.target)
            assert np.abs(step.target - step.start).max() > 1e-3


def test_a_turn_on_planted_feet_inserts_steps_until_they_agree(
    plan: Planned, spin: Motion, retargeter: Retargeter
) -> None:
    steps = plan(spin)
    assert steps and all(step.inserted for step in steps)
    feet = retargeter.body.home_feet.copy()
    for step in steps:
        assert abs(step.target[3] - feet[step.stance, 3]) <= retargeter.gait.max_foot_yaw + 1e-9
        feet[step.side] = step.target
    np.testing.assert_allclose(feet[:, 3], np.radians(80), atol=0.3)


def test_a_foot_that_has_just_landed_stays_down_for_a_while(plan: Planned) -> None:
    """Targets that changed every half second swung one leg repeatedly over the same stance: 9 falls in 688 changes."""
    swings = [("r", 1.06, 1.44, 0.3), ("r", 1.54, 1.92, 0.0), ("r", 2.02, 2.40, 0.3)]
    repeated = build_clip(step_script(swings, 4.0), Body())
    steps = plan(repeated)
    assert [step.side for step in steps[:2]] == [1, 1]
    assert steps[1].lift >= steps[0].land + 0.3 * RATE - 1


@pytest.mark.parametrize("ahead", [-0.08, -0.05, 0.0, 0.05, 0.08])
@pytest.mark.parametrize("free", [0.0, 40.0, 77.0])
def test_feet_rest_between_steps_however_they_stand(
    plan: Planned, walk: Motion, retargeter: Retargeter, ahead: float, free: float
) -> None:
    feet = retargeter.body.home_feet.copy()
    feet[0, 0] += ahead
    last = [-np.inf, -np.inf]
    for step in plan(walk, feet=feet, free=np.array([free, 0.0]), at_rest=False):
        assert step.lift >= last[step.side] + 0.3 * RATE - 1
        assert step.lift >= last[step.stance] + retargeter.gait.double_support_min_s * RATE - 1
        last[step.side] = step.land


def test_steps_after_one_that_was_left_out_make_up_for_it_within_reach(
    plan: Planned, window: Windows, retargeter: Retargeter
) -> None:
    """The way of a step that was left out was lost. It is walked by the next ones, none longer than a swing allows."""
    steps = [("rl"[k % 2], 1.06 + 0.5 * k, 1.44 + 0.5 * k, 0.075 + 0.15 * k) for k in range(7)]
    strolls = build_clip(step_script(steps, 6.0), Body())
    human_feet = window(strolls).feet[0, :, :2]
    late = plan(strolls, free=np.full(2, 290.0), human_feet=human_feet)
    assert late[0].dropped == 1
    feet = retargeter.body.home_feet.copy()
    for step in late:
        assert in_time(retargeter.swings, step)
        feet[step.side] = step.target
    in_time_too = plan(strolls, human_feet=human_feet)[-2:]
    assert feet[:, 0].mean() == pytest.approx(np.mean([step.target[0] for step in in_time_too]), abs=0.03)


def test_the_foot_that_has_rested_longer_is_corrected_first(
    plan: Planned, stand: Callable[..., Motion], retargeter: Retargeter
) -> None:
    """After a stride the foot that had just landed swung back, instead of the other foot forward to it."""
    feet = retargeter.body.home_feet.copy()
    feet[0, 0] += 0.1
    (first, *_) = plan(stand(120), feet=feet, free=np.array([90.0, 0.0]), at_rest=False)
    assert first.side == 1 and first.inserted
    assert first.target[0] == pytest.approx(0.1, abs=0.02)


@pytest.mark.parametrize("turned", [0.0, 0.6, -0.6])
def test_feet_in_the_opposite_stride_are_corrected_within_reach(
    plan: Planned, retargeter: Retargeter, turned: float
) -> None:
    """Clips that changed in mid-stride swung a foot from one stride ahead to one behind: 4 falls in 2,211 changes."""
    in_stride = build_clip(step_script([("r", 1.06, 1.44, 0.5)], 6.0), Body())[60:]
    feet = retargeter.body.home_feet.copy()
    feet[0, 0] += 0.11
    feet[:, 3] = turned
    steps = plan(in_stride, feet=feet, at_rest=False)
    assert steps and all(step.inserted for step in steps)
    for step in steps:
        assert in_time(retargeter.swings, step)
        feet[step.side] = step.target
    assert np.abs(feet[:, 3]).max() < 0.3
    assert feet[1, 0] - feet[0, 0] > 0.03


@pytest.mark.parametrize("side", [0, 1])
@pytest.mark.parametrize("way", [0.1, -0.1])
def test_a_stop_ends_where_the_foot_in_front_is(retargeter: Retargeter, side: int, way: float) -> None:
    """Two steps ended after 4 cm: the left foot always came back to the right one, also where it was in front."""
    feet = retargeter.body.home_feet.copy()
    target = feet[side] + [way, 0.0, 0.0, 0.0]
    step = Step(side, 20, 80, feet[side].copy(), target, 0.0)
    start = FeetState(feet, np.full((2, 2), np.nan), np.full(2, -np.inf), np.zeros(2), [step], at_rest=True)
    steps = retargeter.footsteps.end(start, [step], 0)
    assert [one.side for one in steps] == [side, 1 - side]
    assert steps[-1].target[0] == pytest.approx(target[0])
    landed = np.where(np.arange(2) == side, 90.0, 60.0)
    feet[side] = target
    for at_rest, closes in ((False, 1 - side), (True, side)):
        start = replace(start, feet=feet, settled=[], free=landed, at_rest=at_rest)
        assert [one.side for one in retargeter.footsteps.end(start, [], 0)] == [closes]


@pytest.mark.parametrize("turn", [-0.5, 0.0, 0.5])
def test_the_step_that_ends_a_stop_takes_the_time_it_needs(retargeter: Retargeter, turn: float) -> None:
    """From a long stride in a curve it went 1.27 times as far as a turning foot reaches in .4 s."""
    footsteps, feet = retargeter.footsteps, retargeter.body.home_feet.copy()
    frame = 0.5 * turn
    ahead = 0.11 * np.array([np.cos(frame), np.sin(frame)]) + 0.12 * np.array([-np.sin(frame), np.cos(frame)])
    feet[0] = [*(feet[1, :2] + ahead), 0.0, turn]
    start = FeetState(feet, np.full((2, 2), np.nan), np.full(2, -np.inf), np.array([100.0, 60.0]), [], at_rest=True)
    (last,) = footsteps.end(start, [], 100)
    assert in_time(retargeter.swings, last)
    assert 0.4 <= (last.land - last.lift) / RATE < 0.5
    assert np.hypot(*(last.target - feet[1])[:2]) == pytest.approx(retargeter.body.stand_width)


def test_a_human_who_slides_on_planted_feet_is_followed_by_steps(
    plan: Planned, stand: Callable[..., Motion], window: Windows, retargeter: Retargeter
) -> None:
    """Sampled sidesteps slide on standing feet: a robot that only kept the distance between its feet did not move."""
    motion = stand(150)
    seen = window(motion)
    human_feet = seen.feet[0, :, :2].copy()
    aside = np.arange(150)[:, None] / 30.0 * [0.0, 0.3, 0.0]
    slides = replace(motion, root_position=motion.root_position + aside)
    steps = plan(slides, human_feet=human_feet)
    assert plan(motion, human_feet=human_feet) == []
    assert {step.side for step in steps} == {0, 1}
    feet = retargeter.body.home_feet.copy()
    for step in steps:
        feet[step.side] = step.target
    assert feet[:, 1].mean() > 0.4 * 0.3 * 5.0 * retargeter.body.leg_length / motion.body.leg


def test_an_unfinished_swing_lands_past_the_window(plan: Planned, walk: Motion) -> None:
    cut = walk[:42]
    (step,) = plan(cut)
    assert step.land >= (len(cut) - 1) / cut.fps * RATE


@pytest.mark.parametrize("turned", [-0.15, 0.15])
def test_a_plan_that_is_exact_turns_the_feet_by_small_steps(
    retargeter: Retargeter, view: Views, stand: Callable[..., Motion], turned: float
) -> None:
    """The feet followed no turn below 15°: a turn of 10° became one of 0 or 20°, and ended by its time limit."""
    still = stand(90)
    root = Rotation.from_euler("z", [[turned]] * len(still)).as_quat(scalar_first=True)
    human = view(replace(still, root_quaternion=root))
    feet = retargeter.body.home_feet
    start = FeetState(feet, np.full((2, 2), np.nan), np.full(2, -np.inf), np.zeros(2), [], at_rest=True)
    assert retargeter.footsteps.plan(human, start) == []
    steps = retargeter.footsteps.plan(replace(human, exact=True), start)
    assert sorted(step.side for step in steps) == [0, 1]
    for step in steps:
        assert step.target[3] == pytest.approx(turned, abs=EXACT_YAW)
