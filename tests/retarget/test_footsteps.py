from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from flexmotion.configs.robot_file import Gait
from flexmotion.human.body import Body
from flexmotion.human.motion import Motion
from flexmotion.importers.default_clip import build_clip
from flexmotion.retarget.footsteps import NOTICE_S, UNHURRIED_S, Scaling, Step, settled_from
from flexmotion.retarget.human import HumanWindow
from flexmotion.retarget.retargeter import Retargeter
from flexmotion.retarget.swing import PEAK_ACCELERATION

from .conftest import step_script

RATE = 125
Windows = Callable[[Motion], HumanWindow]


@pytest.fixture(scope="session")
def scaling(retargeter: Retargeter, clip: Motion) -> Scaling:
    return Scaling(retargeter.body.leg_length / clip.body.leg, 0.0, clip.body.segments.hip_width)


@pytest.fixture
def plan(retargeter: Retargeter, window: Windows, scaling: Scaling) -> Callable[..., list[Step]]:
    """Function motion -> steps of a robot that has been standing; keywords as of `FootstepPlanner.plan`."""

    def make(motion: Motion, **changed: object) -> list[Step]:
        asked: dict[str, Any] = {
            "feet": retargeter.body.home_feet,
            "frozen": [],
            "human_feet": np.full((2, 2), np.nan),
            "consumed": np.full(2, -np.inf),
            "free": np.zeros(2),
            "at_rest": True,
            "now": 0,
            "source_tick": 0,
        }
        return retargeter.footsteps.plan(window(motion), scaling, **(asked | changed))

    return make


def reach(gait: Gait, step: Step) -> float:
    """How far a foot may go within a step [m]."""
    seconds = (step.land - step.lift) / RATE
    farthest = min(
        gait.swing_max_foot_speed * seconds, gait.swing_max_foot_acceleration * seconds**2 / PEAK_ACCELERATION
    )
    return float(farthest / (1.0 + gait.swing_turn_cost * abs(step.target[3] - step.start[3])))


def distance(step: Step) -> float:
    """How far its foot goes [m]."""
    return float(np.hypot(*(step.target - step.start)[:2]))


def test_a_walk_gives_its_steps_foot_by_foot(plan: Callable[..., list[Step]], walk: Motion) -> None:
    steps = plan(walk)
    assert [step.side for step in steps] == [1, 0, 1, 0, 1, 0, 1, 0]
    assert not any(step.inserted or step.dropped for step in steps)
    for step, lift_s in zip(steps, 1.06 + 0.5 * np.arange(8), strict=True):
        assert step.lift / RATE == pytest.approx(lift_s, abs=0.2)


def test_steps_keep_to_the_gait_limits(plan: Callable[..., list[Step]], walk: Motion, retargeter: Retargeter) -> None:
    gait, feet = retargeter.gait, retargeter.body.home_feet.copy()
    before = -np.inf
    for step in plan(walk):
        np.testing.assert_array_equal(step.start, feet[step.side])
        assert step.land - step.lift >= gait.swing_min_s * RATE - 1
        assert step.lift - before >= gait.double_support_min_s * RATE - 1e-9
        stance = feet[step.stance]
        assert abs(step.target[0] - stance[0]) <= gait.max_stride + 1e-9
        apart = (step.target[1] - stance[1]) * (1 if step.side == 0 else -1)
        assert gait.lateral[0] - 1e-9 <= apart <= gait.lateral[1] + 1e-9
        assert distance(step) <= reach(gait, step) + 1e-9
        feet[step.side], before = step.target, step.land


def test_a_shuffle_and_a_stand_give_none(
    plan: Callable[..., list[Step]], shuffle: Motion, stand: Callable[..., Motion]
) -> None:
    assert plan(shuffle) == []
    assert plan(stand(90)) == []


def test_no_step_is_begun_on_shorter_notice(plan: Callable[..., list[Step]], walk: Motion) -> None:
    for now in range(0, 5 * RATE, 17):
        for at_rest in (True, False):
            steps = plan(walk, now=now, at_rest=at_rest)
            assert all(step.lift >= now + NOTICE_S * RATE - 1 for step in steps)
            if at_rest and steps:
                assert steps[0].lift >= now + UNHURRIED_S * RATE - 1


@pytest.mark.parametrize("at_rest", [True, False])
def test_inserted_steps_are_never_hurried(plan: Callable[..., list[Step]], spin: Motion, at_rest: bool) -> None:
    """Inserted and left out again by one plan after the other, .25 s ahead, a step threw the weight to and fro."""
    seen = 0
    for now in range(0, 4 * RATE, 17):
        for step in plan(spin, now=now, at_rest=at_rest):
            seen += step.inserted
            assert not step.inserted or step.lift >= now + UNHURRIED_S * RATE - 1
            assert not step.inserted or step.notice_s == UNHURRIED_S
    assert seen > 20


def test_a_step_is_settled_with_the_one_after_it_at_the_latest() -> None:
    """Settled before the one in front of it, an inserted step would be taken for all that there is to do."""
    pose = np.zeros(4)
    hurried = Step(0, 100, 120, pose, pose, 0.0)
    inserted = Step(1, 122, 172, pose, pose, 0.0, inserted=True, notice_s=UNHURRIED_S)
    last = Step(0, 200, 220, pose, pose, 0.0)
    settled = settled_from([hurried, inserted, last], RATE)
    np.testing.assert_allclose(settled, [122 - UNHURRIED_S * RATE] * 2 + [200 - NOTICE_S * RATE])


def test_a_step_that_comes_too_late_is_dropped_and_counted(plan: Callable[..., list[Step]], walk: Motion) -> None:
    steps = plan(walk, now=int(2.2 * RATE))
    assert steps[0].dropped >= 1
    assert len(steps) + sum(step.dropped for step in steps) == 8


def test_frozen_steps_are_kept_as_they_are(plan: Callable[..., list[Step]], walk: Motion) -> None:
    planned = plan(walk)
    again = plan(walk, frozen=planned[:2], now=planned[0].lift + 5)
    assert again[:2] == planned[:2]
    assert again[2].side == planned[2].side
    np.testing.assert_array_equal(again[2].start, planned[0].target)
    assert again[2].lift >= planned[1].land


def test_what_is_consumed_does_not_come_again(plan: Callable[..., list[Step]], walk: Motion) -> None:
    planned = plan(walk)
    consumed = np.array([planned[1].consumed_s, planned[0].consumed_s])
    rest = plan(walk, consumed=consumed)
    assert [round(s.consumed_s, 6) for s in rest] == [round(s.consumed_s, 6) for s in planned[2:]]


@pytest.mark.parametrize("later_s", [0.01, 0.04])
def test_a_swing_that_is_redrawn_to_land_later_is_not_another_step(
    plan: Callable[..., list[Step]], walk: Motion, later_s: float
) -> None:
    """A step was settled; the next window had its foot land 40 ms later: the same foot stepped twice, and it fell."""
    planned = plan(walk)
    consumed = np.array([-np.inf, planned[0].consumed_s - later_s])
    again = plan(walk, consumed=consumed, frozen=[planned[0]], now=planned[0].lift - 10)
    assert [step.side for step in again] == [step.side for step in planned]


def test_a_swing_whose_landing_comes_into_sight_is_not_another_step(
    plan: Callable[..., list[Step]], walk: Motion
) -> None:
    """The first window ends in mid-swing, as that of a short plan does; the next one shows where the foot lands."""
    (early,) = plan(walk[:42])
    assert early.consumed_s == pytest.approx(early.land / RATE, abs=0.01)
    consumed = np.array([-np.inf, early.consumed_s])
    again = plan(walk, consumed=consumed, frozen=[early], now=early.lift - 10)
    assert [step.side for step in again] == [1, 0, 1, 0, 1, 0, 1, 0]


def test_a_step_may_be_put_off(plan: Callable[..., list[Step]], walk: Motion) -> None:
    now = int(0.9 * RATE)
    soon, later = plan(walk, now=now), plan(walk, now=now, put_off=12)
    assert later[0].side == soon[0].side and later[0].lift == soon[0].lift + 12
    settled = plan(walk, now=now + 60, frozen=[soon[0]], put_off=12)
    assert settled[0] is soon[0]


def test_start_poses_are_copies_of_the_feet(
    plan: Callable[..., list[Step]], walk: Motion, spin: Motion, retargeter: Retargeter
) -> None:
    """A start that was a view of the planner's feet became the target: the foot jumped there at lift-off."""
    feet = retargeter.body.home_feet.copy()
    for motion in (walk, spin):
        steps = plan(motion, feet=feet)
        np.testing.assert_array_equal(feet, retargeter.body.home_feet)
        for step in steps:
            assert not np.shares_memory(step.start, feet)
            assert not np.shares_memory(step.start, step.target)
            assert np.abs(step.target - step.start).max() > 1e-3


def test_a_turn_on_planted_feet_inserts_steps_until_they_agree(
    plan: Callable[..., list[Step]], spin: Motion, retargeter: Retargeter
) -> None:
    steps = plan(spin)
    assert steps and all(step.inserted for step in steps)
    feet = retargeter.body.home_feet.copy()
    for step in steps:
        assert abs(step.target[3] - feet[step.stance, 3]) <= retargeter.gait.max_foot_yaw + 1e-9
        feet[step.side] = step.target
    np.testing.assert_allclose(feet[:, 3], np.radians(80), atol=0.3)


def test_a_foot_that_has_just_landed_does_not_lift_again_at_once(plan: Callable[..., list[Step]]) -> None:
    """Targets that changed every half second swung one leg to and fro over the same stance: 9 falls in 688 changes."""
    swings = [("r", 1.06, 1.44, 0.3), ("r", 1.54, 1.92, 0.0), ("r", 2.02, 2.40, 0.3)]
    to_and_fro = build_clip(step_script(swings, 4.0), Body())
    steps = plan(to_and_fro)
    assert [step.side for step in steps[:2]] == [1, 1]
    assert steps[1].lift >= steps[0].land + 0.3 * RATE - 1


@pytest.mark.parametrize("ahead", [-0.08, -0.05, 0.0, 0.05, 0.08])
@pytest.mark.parametrize("free", [0.0, 40.0, 77.0])
def test_feet_rest_between_steps_however_they_stand(
    plan: Callable[..., list[Step]], walk: Motion, retargeter: Retargeter, ahead: float, free: float
) -> None:
    feet = retargeter.body.home_feet.copy()
    feet[0, 0] += ahead
    last = [-np.inf, -np.inf]
    for step in plan(walk, feet=feet, free=np.array([free, 0.0]), at_rest=False):
        assert step.lift >= last[step.side] + 0.3 * RATE - 1
        assert step.lift >= last[step.stance] + retargeter.gait.double_support_min_s * RATE - 1
        last[step.side] = step.land


def test_a_step_that_is_left_out_is_not_caught_up_with(plan: Callable[..., list[Step]], window: Windows) -> None:
    """Counted from where the foot stood that should have stepped, the next two strides were twice as long."""
    steps = [("rl"[k % 2], 1.06 + 0.5 * k, 1.44 + 0.5 * k, 0.075 + 0.15 * k) for k in range(7)]
    strolls = build_clip(step_script(steps, 6.0), Body())
    human_feet = window(strolls).feet[0, :, :2]
    late = plan(strolls, free=np.full(2, 290.0), human_feet=human_feet)
    assert late[0].dropped == 1
    strides = [step.target[0] - step.start[0] for step in late]
    regular = max(step.target[0] - step.start[0] for step in plan(strolls, human_feet=human_feet))
    assert max(strides[:2]) < 1.2 * regular


def test_feet_are_set_right_by_turns(
    plan: Callable[..., list[Step]], stand: Callable[..., Motion], retargeter: Retargeter
) -> None:
    """After a stride the foot that had just landed was swung back, instead of the other brought up to it."""
    feet = retargeter.body.home_feet.copy()
    feet[0, 0] += 0.1
    (first, *_) = plan(stand(120), feet=feet, free=np.array([90.0, 0.0]), at_rest=False)
    assert first.side == 1 and first.inserted
    assert first.target[0] == pytest.approx(0.1, abs=0.02)


@pytest.mark.parametrize("turned", [0.0, 0.6, -0.6])
def test_feet_a_stride_the_other_way_are_set_right_within_reach(
    plan: Callable[..., list[Step]], retargeter: Retargeter, turned: float
) -> None:
    """Clips that changed in mid-stride swung a foot from one stride ahead to one behind at once: 4 falls in 2,211."""
    in_stride = build_clip(step_script([("r", 1.06, 1.44, 0.5)], 6.0), Body())[60:]
    feet = retargeter.body.home_feet.copy()
    feet[0, 0] += 0.11
    feet[:, 3] = turned
    steps = plan(in_stride, feet=feet, at_rest=False)
    assert steps and all(step.inserted for step in steps)
    for step in steps:
        assert distance(step) <= reach(retargeter.gait, step) + 1e-9
        feet[step.side] = step.target
    assert np.abs(feet[:, 3]).max() < 0.3
    assert feet[1, 0] - feet[0, 0] > 0.03


@pytest.mark.parametrize("turn", [-0.5, 0.0, 0.5])
def test_the_step_that_ends_a_stop_takes_the_time_it_needs(retargeter: Retargeter, turn: float) -> None:
    """From a long stride in a bend it went 1.27 times as far as a turning foot reaches in .4 s."""
    footsteps, feet = retargeter.footsteps, retargeter.body.home_feet.copy()
    frame = 0.5 * turn
    ahead = 0.11 * np.array([np.cos(frame), np.sin(frame)]) + 0.12 * np.array([-np.sin(frame), np.cos(frame)])
    feet[0] = [*(feet[1, :2] + ahead), 0.0, turn]
    (last,) = footsteps.gather([], feet, after=100)
    assert distance(last) <= reach(retargeter.gait, last) + 1e-9
    assert 0.4 <= (last.land - last.lift) / RATE < 0.5
    assert np.hypot(*(last.target - feet[1])[:2]) == pytest.approx(footsteps.stand_width)


def test_a_human_who_slides_on_his_feet_is_stepped_after(
    plan: Callable[..., list[Step]], stand: Callable[..., Motion], window: Windows, retargeter: Retargeter
) -> None:
    """Samples of stepping aside slide on standing feet: feet that only kept their distance stayed where they were."""
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


def test_an_unfinished_swing_lands_past_the_window(plan: Callable[..., list[Step]], walk: Motion) -> None:
    cut = walk[:42]
    steps = plan(cut)
    assert len(steps) == 1
    assert steps[0].land >= (len(cut) - 1) / 30 * RATE


def test_toes_turn_in_less_than_out(window: Windows, scaling: Scaling, retargeter: Retargeter, walk: Motion) -> None:
    gait, seen = retargeter.gait, window(walk)
    for heading in (-3.0, 3.0):
        turned = Scaling(scaling.ratio, heading, scaling.human_width)
        for side in (0, 1):
            stance = retargeter.body.home_feet[1 - side]
            yaw = retargeter.footsteps.target(seen, turned, side, 0.0, 0.5, stance, np.full(2, np.nan)).pose[3]
            outward = (heading > 0) == (side == 0)
            assert abs(yaw) == pytest.approx(gait.max_foot_yaw if outward else gait.max_toe_in)


def test_a_foot_that_turns_reaches_less_far(retargeter: Retargeter) -> None:
    """Went wrong: a bend was walked in strides as long as straight on, and half of the weaker robots fell outwards."""
    start, stance = np.array([0.0, 0.05, 0, 0]), np.array([0.0, -0.05, 0, 0])
    reach = [
        np.hypot(*retargeter.footsteps.within_reach(start, np.array([0.3, 0.05, 0, yaw]), stance, 0.4)[:2] - start[:2])
        for yaw in (0.0, 0.5, -0.5)
    ]
    assert reach[1] == pytest.approx(reach[0] / 1.5) and reach[2] == pytest.approx(reach[1])


@example(ahead=1.0, apart=0.0, askew=-0.4, heading=1.5, second=1.05, side=0, seconds=0.34)
@example(ahead=1.0, apart=0.0, askew=0.4, heading=-1.5, second=3.0, side=1, seconds=0.34)
@settings(max_examples=200)
@given(
    ahead=st.floats(-1.0, 1.0),
    apart=st.floats(0.0, 1.0),
    askew=st.floats(-0.4, 0.4),
    heading=st.sampled_from([-1.5, -0.5, 0.0, 0.5, 1.5]),
    second=st.floats(1.0, 4.5),
    side=st.sampled_from([0, 1]),
    seconds=st.sampled_from([0.34, 0.4, 0.5]),
)
def test_no_step_leaves_the_feet_more_than_a_stride_apart(
    retargeter: Retargeter,
    window: Windows,
    walk: Motion,
    ahead: float,
    apart: float,
    askew: float,
    heading: float,
    second: float,
    side: int,
    seconds: float,
) -> None:
    """In curves a foot fell up to 23 cm behind where 11 are allowed: what it turned left it no reach to come along."""
    gait, footsteps, seen = retargeter.gait, retargeter.footsteps, window(walk)
    room = gait.lateral[0] + footsteps.sole_half_length * abs(np.sin(askew))
    across = (room + apart * max(gait.lateral[1] - room, 0.0)) * (1.0 if side == 0 else -1.0)
    along = gait.max_stride * ahead * np.sqrt(1.0 - apart**2)
    cos, sin = np.cos(0.5 * askew), np.sin(0.5 * askew)
    feet = np.zeros((2, 4))
    feet[side] = [cos * along - sin * across, sin * along + cos * across, 0.0, askew]
    ratio = retargeter.body.leg_length / walk.body.leg
    scaling = Scaling(ratio, heading, walk.body.segments.hip_width)
    found = footsteps.foothold(seen, scaling, side, (second, second), feet, np.full((2, 2), np.nan), seconds).pose
    middle = 0.5 * found[3]
    assert abs(np.cos(middle) * found[0] + np.sin(middle) * found[1]) <= gait.max_stride + 1e-3 + 1e-9
    assert footsteps.shortest_swing_s(feet[side], found) <= seconds + 1e-5


def test_a_target_out_of_reach_is_brought_back_along_the_stride(retargeter: Retargeter) -> None:
    start, stance = np.array([0.0, 0.05, 0, 0]), np.array([0.0, -0.05, 0, 0])
    target = np.array([0.5, 0.06, 0, 0.1])
    found = retargeter.footsteps.within_reach(start, target, stance, 0.4)
    step = Step(0, 0, round(0.4 * RATE), start, found, 0.0)
    assert distance(step) == pytest.approx(reach(retargeter.gait, step))
    assert retargeter.footsteps.shortest_swing_s(start, found) == pytest.approx(0.4)
    assert found[0] < target[0] and found[3] == target[3]
    near = np.array([0.02, 0.05, 0, 0])
    np.testing.assert_array_equal(retargeter.footsteps.within_reach(start, near, stance, 0.4), near)
