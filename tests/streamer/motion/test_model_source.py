"""A source that samples: the same frames again, changes at their frame, old frames dropped."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from flexmotion.configs.errors import ConfigError
from flexmotion.human.motion import Motion
from flexmotion.human.resample import resample
from flexmotion.sampling.pace import Pace
from flexmotion.spatial.heading import continuous_heading, heading
from flexmotion.streamer.motion.intents import Clip, Heading, Intent, Stop, Text, Velocity, Waypoint
from flexmotion.streamer.motion.model_source import ModelSource
from flexmotion.streamer.motion.script import Item
from flexmotion.streamer.motion.sources import ClipSource, LiveSource, Performance
from flexmotion.streamer.motion.targets import Target

from ..stub_sampler import StubSampler

WALK, TURN = Text("walk forward"), Text("turn left")
SCRIPT = (Item(0.0, WALK), Item(2.5, TURN), Item(4.0, Text("stand still")))


def source(*items: Item, sampler: StubSampler | None = None, **how: Any) -> ModelSource:
    return ModelSource(sampler or StubSampler(), items or SCRIPT, "model:stub", **how)  # type: ignore[arg-type]


def target(intent: Intent) -> Target:
    return Target(1, 1, intent)


def pose(motion: Motion) -> np.ndarray:
    """All that the stub samples: root position and heading, (T, 4)."""
    return np.column_stack([motion.root_position, continuous_heading(motion.root_quaternion)])


def test_it_is_live_and_a_performance() -> None:
    assert isinstance(source(), LiveSource) and isinstance(source(), Performance)


@pytest.mark.parametrize("straight", [True, False])
def test_what_a_course_needs_is_made_before_the_run(straight: bool) -> None:
    """A sampler made its derivatives for the first window that was asked to be straight: .2 s of the first plan."""
    stub = StubSampler()
    source(sampler=stub, straight=straight)
    assert stub.prepared is straight


def test_a_new_window_repeats_the_frames_and_adds_more() -> None:
    it = source()
    first = it.window(0, 40)
    assert first is not None and len(first) == 40
    for begin in (0, 7, 15, 31):
        again = it.window(begin, 40)
        assert again is not None and len(again) == 40
        np.testing.assert_array_equal(pose(again)[: 40 - begin], pose(first)[begin:])
        assert again.wrenches is not None


def test_what_is_sampled_ahead_is_what_later_windows_give() -> None:
    it = source()
    assert it.window(0, 40) is not None
    ahead = it.sampled(20)
    assert ahead is not None and len(ahead) > 20  # more than any window has given
    later = it.window(20, len(ahead))
    assert later is not None
    np.testing.assert_array_equal(pose(ahead), pose(later))


def test_frames_that_are_dropped_or_not_sampled_are_not_given() -> None:
    it = source()
    for begin in range(0, 300, 10):
        assert it.window(begin, 32) is not None
    assert it.sampled(100) is None and it.sampled(2000) is None


def test_motion_depends_on_the_seed_and_not_on_the_windows_requested() -> None:
    whole = source(seed=3).window(0, 150)
    it, parts = source(seed=3), []
    for begin in range(0, 150, 10):
        part = it.window(begin, 32)
        assert part is not None
        parts.append(part[:10])
    assert whole is not None
    np.testing.assert_array_equal(np.concatenate([pose(part) for part in parts]), pose(whole))
    other = source(seed=4).window(0, 150)
    assert other is not None and np.abs(pose(other) - pose(whole)).max() > 0


def test_every_window_is_limited_to_the_robots_pace() -> None:
    sampler, pace = StubSampler(), Pace(0.5, 0.4, 0.2, 1.0)
    it = source(Item(0.0, WALK), Item(1.0, Velocity(2.0, 0.0, 0.0)), sampler=sampler, pace=pace)
    assert it.window(0, 60) is not None and it.cut(1.0).pace == pace
    assert it.turn_to(target(TURN), 40, None) is None
    assert it.window(41, 30) is not None
    assert {asked.condition.pace for asked in sampler.asked} == {pace}
    told = it.turn_to(target(Velocity(2.0, 0.0, 0.0)), 80, None)
    assert told == "velocity [2.0, 0.0, 0.0] is slowed to a human's 0.5 m/s ahead, so that the robot can follow"
    assert it.turn_to(target(Velocity(0.5, 0.0, 0.0)), 90, None) is None
    turned = it.turn_to(target(Velocity(-0.3, -0.2, 2.0)), 95, None)
    assert turned is not None and "0.15 m/s back and 0.1 m/s to the right and 1 rad/s turning left" in turned
    assert it.remarks == (told,)
    deaf = source(Item(0.0, WALK), sampler=StubSampler(follows_velocity=False), pace=pace)
    assert deaf.remarks == ("model stub follows no velocity: its motion is not slowed to the robot's speed",)


def test_a_joystick_held_too_far_is_reported_once() -> None:
    """Ten velocities a second were ten notes a second, which hid faults."""
    it = source(Item(0.0, WALK), pace=Pace(0.5, 0.4, 0.2, 1.0))
    pushed = [it.turn_to(target(Velocity(1.0 + 0.01 * i, 0.0, 0.0)), 10 + i, None) for i in range(10)]
    assert pushed[0] is not None and pushed[1:] == [None] * 9
    assert it.turn_to(target(Velocity(0.3, 0.0, 0.0)), 30, None) is None
    assert it.turn_to(target(Velocity(1.0, 0.0, 0.0)), 31, None) is not None


def test_a_script_is_followed_to_the_frame() -> None:
    sampler = StubSampler()
    motion = source(sampler=sampler).window(0, 150)
    assert motion is not None
    moved = np.diff(motion.root_position[:, 0])
    np.testing.assert_allclose(moved[:74], 1.0 / 30.0)
    np.testing.assert_allclose(moved[74:], 0.0, atol=1e-12)
    turned = np.diff(continuous_heading(motion.root_quaternion))
    np.testing.assert_allclose(turned[74:119], 1.0 / 30.0)
    np.testing.assert_allclose(turned[119:], 0.0, atol=1e-12)
    assert sampler.read == ["walk forward", "turn left", "stand still"]  # before anything moves


@pytest.mark.parametrize("unsettled", [0, 6])
def test_a_window_is_sampled_when_it_is_needed(unsettled: int) -> None:
    """Windows whose forces do not change were sampled six frames before they were used, which delayed plans."""
    sampler = StubSampler()
    sampler.unsettled = unsettled
    it, sampled = source(Item(0.0, WALK), sampler=sampler), []
    for end in (32 - unsettled, 33 - unsettled, 64 - unsettled, 65 - unsettled):
        assert it.window(0, end) is not None
        sampled.append(len(sampler.asked))
    assert sampled == [1, 2, 2, 3]
    # A shorter look-ahead samples the same motion.
    other, motion = source(Item(0.0, WALK)).window(0, 40), it.window(0, 40)
    assert other is not None and motion is not None
    np.testing.assert_array_equal(pose(motion), pose(other))


@pytest.mark.parametrize("gesture", ["bow", "wave"])
def test_who_walks_on_through_a_gesture_stands_first(gesture: str) -> None:
    # "Walk forward", then "bow": the human walked on for good and never bowed, as people of the data walk before it.
    stub = StubSampler()
    it = source(Item(0.0, WALK), Item(2.0, Text(gesture)), sampler=stub)
    motion = it.window(0, 240)
    assert motion is not None
    way = np.linalg.norm(np.diff(motion.root_position[::30, :2], axis=0), axis=1)
    assert way[0] == pytest.approx(1.0, abs=0.05) and way[-1] == pytest.approx(0.0, abs=0.01)
    asked = [each.condition.text for each in stub.asked if each.begin.root_position[-1, 0] > 1.5]
    assert asked[0] == gesture and asked[-1] == gesture
    assert (None in asked) is (gesture == "bow")


def test_before_the_first_item_it_stands() -> None:
    sampler = StubSampler()
    assert source(Item(1.0, WALK), sampler=sampler).window(0, 32) is not None
    assert sampler.asked[0].condition.text is None and sampler.asked[0].condition.velocity is None


def test_a_velocity_reaches_the_sampler_unchanged() -> None:
    sampler = StubSampler()
    motion = source(Item(0.0, Velocity(0.5, 0.1, -0.5)), sampler=sampler).window(0, 31)
    assert sampler.asked[0].condition.velocity == (0.5, 0.1, -0.5) and motion is not None
    assert continuous_heading(motion.root_quaternion)[-1] == pytest.approx(-0.5 * 31 / 30)


def test_a_target_continues_the_motion_that_was_played() -> None:
    sampler = StubSampler()
    it = source(sampler=sampler)
    before = it.window(20, 32)
    assert before is not None
    played = before[:11]  # to frame 30
    played.root_position[:, 1] += 0.05  # not the sampled motion: it was blended
    it.turn_to(target(TURN), 30, played)
    after = it.window(30, 60)
    assert after is not None
    np.testing.assert_array_equal(pose(after)[0], pose(played)[-1])
    np.testing.assert_allclose(after.root_position[:, 1], played.root_position[-1, 1])
    np.testing.assert_allclose(np.diff(continuous_heading(after.root_quaternion)), 1.0 / 30.0)
    begin = sampler.asked[-3].begin
    np.testing.assert_array_equal(pose(begin)[-10:], pose(played)[-10:])
    # The rest of the script is over.
    later = it.window(80, 60)
    assert later is not None and np.ptp(continuous_heading(later.root_quaternion)[[0, -1]]) > 1.0


def test_forces_return_after_a_target_that_continued_motion_without_them() -> None:
    """One piece without forces removed them from all windows after it."""
    it = source()
    sampled = it.window(0, 32)
    assert sampled is not None
    it.turn_to(target(TURN), 20, replace(sampled[:21], wrenches=None))
    joint, after = it.window(20, 32), it.window(21, 32)
    assert joint is not None and joint.wrenches is None
    assert after is not None and after.wrenches is not None and len(after.wrenches) == 32
    np.testing.assert_array_equal(pose(after)[:31], pose(joint)[1:])


def test_a_short_played_motion_is_completed_from_the_sampled_one() -> None:
    sampler = StubSampler()
    it = source(sampler=sampler)
    sampled = it.window(0, 32)
    assert sampled is not None
    it.turn_to(target(TURN), 20, sampled[19:21])
    assert it.window(20, 10) is not None
    np.testing.assert_array_equal(pose(sampler.asked[-1].begin), pose(sampled)[11:21])


def test_a_target_may_be_applied_again_at_an_earlier_frame() -> None:
    """A plan for a target may be abandoned and made again with an earlier join."""
    it = source()
    sampled = it.window(0, 40)
    assert sampled is not None
    it.turn_to(target(TURN), 20, sampled[:21])
    assert it.window(20, 32) is not None
    it.turn_to(target(TURN), 18, sampled[:19])
    again = it.window(18, 32)
    assert again is not None
    np.testing.assert_array_equal(pose(again)[0], pose(sampled)[18])
    assert np.diff(continuous_heading(again.root_quaternion))[0] == pytest.approx(1.0 / 30.0)


def test_a_target_that_is_given_up_leaves_nothing_behind() -> None:
    """Of two targets in quick succession the newer one repeated the one before it, of which nothing was played."""
    sources = [source() for _ in range(2)]
    for it in sources:
        played = it.window(0, 40)
        assert played is not None
        if it is sources[0]:
            undo = it.kept()
            it.turn_to(target(TURN), 30, played[:31])
            assert it.window(31, 40) is not None
            undo()
        it.turn_to(target(Text("again")), 31, played[:32])
    windows = [it.window(32, 40) for it in sources]
    assert windows[0] is not None and windows[1] is not None
    np.testing.assert_array_equal(pose(windows[0]), pose(windows[1]))
    assert sources[0].answer == sources[1].answer
    assert sources[0].program_at(32) == sources[1].program_at(32)


def test_a_refused_change_of_speed_is_no_part_of_what_goes_on() -> None:
    """Regression: of a measured walk, "faster" at the greatest speed took the steps away, and the planner crashed."""
    own = source(pace=Pace(0.5, 0.4, 0.2, 0.5))
    own.turn_to(target(Velocity(0.5, 0.0, 0.0)), 5, None)
    walk = own.program_at(6)
    with pytest.raises(ConfigError, match="greatest speed already; it goes on"):
        own.turn_to(target(Text("faster")), 20, None)
    assert walk is not None and own.program_at(21) == walk


def test_a_refused_change_of_speed_in_a_script_leaves_the_item_before() -> None:
    own = source(Item(0.0, Velocity(0.5, 0.0, 0.0)), Item(2.0, Text("faster")), pace=Pace(0.5, 0.4, 0.2, 0.5))
    assert [heard.state for heard in own.heard_items] == ["accepted", "refused"]
    assert own.program_at(0) == own.program_at(100) and own.program_at(100) is not None


def test_a_velocity_of_nothing_is_a_stand_and_nothing_under_way() -> None:
    """Regression: "one more step" after it was "velocity 1 step", and the robot stood for ten seconds."""
    own = source()
    own.turn_to(target(Velocity(0.0, 0.0, 0.0)), 5, None)
    for words in ("slower", "keep going"):
        own.turn_to(target(Text(words)), 20, None)
        assert own.answer is not None and own.answer.state == "refused", words


def test_nothing_is_under_way_after_a_stop() -> None:
    """Regression: "slower" after a STOP made a standing robot walk."""
    own = source()
    own.turn_to(target(Velocity(0.4, 0.0, 0.0)), 5, None)
    found = own.program_at(6)
    assert found is not None
    own.stopped(found[1])
    own.turn_to(target(Text("slower")), 20, None)
    assert own.answer is not None and "nothing is under way" in str(own.answer.reason)


def test_a_stop_ends_it_and_a_target_after_it_begins_from_a_stand() -> None:
    it = source(Item(0.0, WALK))
    sampled = it.window(0, 40)
    assert sampled is not None
    it.turn_to(target(Stop()), 20, sampled[:21])
    assert it.window(20, 32) is None and it.window(5000, 32) is None
    it.turn_to(target(WALK), 9000, None)
    after = it.window(9000, 32)
    assert after is not None
    np.testing.assert_allclose(after.root_position[0, :2], sampled.root_position[20, :2])
    np.testing.assert_allclose(np.diff(after.root_position[:, 0]), 1.0 / 30.0)


def test_after_a_long_gap_the_human_has_stopped() -> None:
    sampler = StubSampler()
    it = source(Item(0.0, WALK), sampler=sampler)
    sampled = it.window(0, 40)
    after = it.window(90_000, 10)
    assert sampled is not None and after is not None and len(sampler.asked) == 3
    assert after.root_position[0, 0] == pytest.approx(64 / 30 + 1 / 30)


def test_it_ends_at_its_length_and_at_the_scripts_stop() -> None:
    it = source(seconds=3.0)
    assert it.seconds == 3.0 and len(it.window(80, 40) or ()) == 11 and it.window(90, 40) is None
    stopped = source(*SCRIPT, Item(5.0, Stop()))
    assert stopped.seconds == 5.0 and len(stopped.window(140, 40) or ()) == 10 and stopped.window(149, 2) is None
    assert stopped.cut(2.0).seconds == 2.0 and stopped.cut(9.0).seconds == 5.0 and source().seconds is None


def test_a_script_that_is_done_ends_it_and_a_target_that_is_done_does_not() -> None:
    """Went wrong: `dry-run --web --seconds 120` parked the robot once a heading, or a turn of 45 degrees, was done."""
    it = source(Item(0.0, Text("walk for one second")), seconds=120.0)
    it.turn_to(target(Text("walk two steps")), 20, None)
    it.finish(60)
    assert not it.is_over(900) and it.window(900, 30) is not None
    script = source(Item(0.0, Text("walk for one second")), seconds=120.0)
    script.finish(60)
    assert script.is_over(900)


def test_the_whole_motion_is_that_of_the_windows() -> None:
    it = source(seconds=3.0)
    windows = [it.window(begin, 10) for begin in range(0, 90, 10)]
    human = it.human()
    assert len(human) == 91 and isinstance(human.wrenches, np.ndarray)
    joined = np.concatenate([pose(window) for window in windows if window is not None])
    np.testing.assert_array_equal(pose(human)[:90], joined)
    with pytest.raises(ValueError, match="has no end"):
        source().human()


def test_an_hour_takes_no_more_memory_than_a_minute() -> None:
    it = source(Item(0.0, WALK))
    for begin in range(0, 108_000, 60):
        assert it.window(begin, 32) is not None
    assert sum(len(piece) for piece in it._pieces) < 200 and len(it._schedule) == 1
    with pytest.raises(LookupError, match="frame 0 was dropped"):
        it.window(0, 32)


def test_an_intent_that_the_model_cannot_follow_is_refused() -> None:
    with pytest.raises(ConfigError, match="clip: 'walk.bvh' is unknown; this run takes none; start it with --clips"):
        source().turn_to(target(Clip("walk.bvh")), 3, None)
    for intent in (Velocity(1.0, 0.0, 0.0), Heading(1.0), Waypoint(1.0, 0.0)):
        with pytest.raises(ConfigError, match="model stub follows no velocity"):
            source(Item(0.0, intent), sampler=StubSampler(follows_velocity=False))


def test_a_manner_that_the_model_does_not_offer_is_refused_before_the_run() -> None:
    """It ended the planner at run time, with a message that listed what the model was not judged to do."""
    with pytest.raises(ConfigError, match="velocity: manner 'proudly', model stub offers: normal, old$"):
        source(Item(0.0, Velocity(0.7, 0.0, 0.0, manner="proudly")))
    source(Item(0.0, Velocity(0.7, 0.0, 0.0, manner="old")))


def with_clip() -> tuple[ModelSource, Motion]:
    """A source with a clip of two seconds that walks ahead."""
    from flexmotion.importers.default_clip import default_clip

    clip = resample(default_clip()[225:465], 30.0)
    items = [Item(0.0, Velocity(0.0, 0.0, 1.0))]
    return ModelSource(StubSampler(), items, "model:stub", clips={"walk.bvh": clip}), clip  # type: ignore[arg-type]


def test_a_clip_that_the_run_was_started_with_is_followed_where_the_human_stands_and_then_it_stands() -> None:
    """Targets that named a clip were refused in every run of a model."""
    it, clip = with_clip()
    before = it.window(0, 45)
    assert before is not None
    it.turn_to(target(Clip("walk.bvh")), 40, before[:41])
    motion = it.window(41, len(clip) + 40)
    assert motion is not None and len(motion) == len(clip) + 40
    np.testing.assert_allclose(motion.joints[: len(clip)], clip.joints)
    np.testing.assert_allclose(motion.root_position[0, :2], before.root_position[40, :2], atol=1e-9)
    turned = heading(before.root_quaternion[40]) - heading(motion.root_quaternion[0])
    assert abs(math.remainder(turned, math.tau)) < 1e-6
    # After its end the model goes on from the clip's last pose, and is asked for nothing.
    assert it.sampler.asked[-1].condition.velocity is None  # type: ignore[attr-defined]


def test_a_clip_is_answered_with_its_length_and_an_unknown_one_with_the_names() -> None:
    it, clip = with_clip()
    it.turn_to(target(Clip("walk.bvh")), 3, None)
    assert it.answer is not None and it.answer.heard_as == "clip"
    assert it.answer.steps[0].amount == pytest.approx(clip.duration, abs=1e-3)
    with pytest.raises(ConfigError, match="'bow' is unknown; this run takes: walk.bvh"):
        it.turn_to(target(Clip("bow")), 30, None)


def test_a_goal_is_answered_and_its_human_stands_until_the_robots_place_is_known() -> None:
    it = source()
    it.turn_to(target(Waypoint(1.0, 0.5, math.pi)), 3, None)
    assert it.answer is not None and it.answer.state == "accepted"
    assert it.answer.asked == "waypoint 1 m ahead, 0.5 m left, heading 180°"
    found = it.program_at(10)
    assert found is not None and found[1].steps[0].goal == Waypoint(1.0, 0.5, math.pi) and not found[1].is_open


def test_a_clip_is_a_performance_and_not_a_live_source() -> None:
    from flexmotion.importers.default_clip import default_clip

    clip = ClipSource(default_clip())
    assert isinstance(clip, Performance) and not isinstance(clip, LiveSource)
    assert len(clip.cut(1.0).human()) == 31
