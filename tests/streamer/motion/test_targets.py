"""Targets and requests in shared memory, and the clip library that follows targets."""

from __future__ import annotations

import time

import numpy as np
import pytest

from flexmotion.configs.errors import ConfigError
from flexmotion.importers.default_clip import default_clip
from flexmotion.spatial.heading import heading
from flexmotion.streamer.motion.clip_library import ClipLibrary
from flexmotion.streamer.motion.intents import Clip, Heading, Intent, Stop, Text, Velocity, Waypoint
from flexmotion.streamer.motion.sources import ClipSource, LiveSource
from flexmotion.streamer.motion.targets import NO_TARGET, TargetMailbox, arrived
from flexmotion.streamer.run.requests import Request, RequestChannel


def test_the_newest_target_counts_and_the_log_sees_all() -> None:
    mailbox = TargetMailbox()
    reader = mailbox.reader()
    assert mailbox.newest() is NO_TARGET
    before = time.perf_counter_ns()
    asked = (
        Clip("wave"),
        Text("gehen – schnell"),
        Velocity(0.5, -0.1, 1.0),
        Heading(1.5),
        Waypoint(1.0, -2.0, 0.1),
        Stop(),
    )
    sent = [mailbox.send(intent) for intent in asked]
    assert mailbox.newest() == sent[-1] and sent[-1].id == 6
    assert before <= sent[0].stamp_ns <= sent[-1].stamp_ns <= time.perf_counter_ns()
    assert arrived(reader) == sent and arrived(reader) == []


def test_a_name_that_is_too_long_is_refused() -> None:
    with pytest.raises(ConfigError, match="text: 242 bytes, expected at most 240"):
        TargetMailbox().send(Text("é" * 121))


def test_a_velocity_that_is_not_finite_is_not_sent() -> None:
    """It reached the sampler."""
    mailbox = TargetMailbox()
    with pytest.raises(ConfigError, match="velocity: expected"):
        mailbox.send(Velocity(np.nan, 99, 0))
    assert mailbox.newest() is NO_TARGET


def test_a_velocity_with_a_manner_is_not_sent() -> None:
    """The manner was dropped without a word: the answer said that the velocity was accepted."""
    mailbox = TargetMailbox()
    with pytest.raises(ConfigError, match="manner 'old': a target's velocity has the normal manner; say the"):
        mailbox.send(Velocity(0.7, 0.0, 0.0, manner="old"))
    assert mailbox.newest() is NO_TARGET


@pytest.mark.parametrize("intent", [Text("walk", beside=Text("wave")), Velocity(0.5, 0.0, 0.0, beside=Text("wave"))])
def test_a_gesture_beside_is_sent_in_words_alone(intent: Text | Velocity) -> None:
    """It would have been left out without a word: a target holds words or a velocity."""
    mailbox = TargetMailbox()
    with pytest.raises(ConfigError, match="beside 'wave': say both in words, as in 'walk while waving'"):
        mailbox.send(intent)
    assert mailbox.newest() is NO_TARGET


@pytest.mark.parametrize("manner", [7, float("nan"), ""])
def test_a_manner_that_is_no_name_is_refused(manner: object) -> None:
    with pytest.raises(ConfigError, match="velocity: manner: expected the name of a manner"):
        Velocity(0.7, 0.0, 0.0, manner=manner)  # type: ignore[arg-type]


def test_requests_are_read_in_order_with_their_reasons() -> None:
    requests = RequestChannel()
    reader = requests.reader()
    assert reader.read() == []
    requests.send(Request.STOP)
    requests.send(Request.FAULT, "the planner: nothing to plan – ü")
    assert reader.read() == [(Request.STOP, ""), (Request.FAULT, "the planner: nothing to plan – ü")]
    requests.send(Request.NOTE, "y" * 600)
    ((_, reason),) = reader.read()
    assert reason == "y" * 488


def library() -> ClipLibrary:
    motion = default_clip()
    return ClipLibrary({"wave": motion[0:120], "walk": motion[225:330]}, "wave")


def test_a_library_is_live_and_a_clip_is_not() -> None:
    assert isinstance(library(), LiveSource)
    assert not isinstance(ClipSource(default_clip()), LiveSource)


def test_another_clip_begins_at_the_humans_position_and_heading() -> None:
    source, mailbox = library(), TargetMailbox()
    before = source.window(40, 20)
    assert before is not None
    here = default_clip()[300:301]
    source.turn_to(mailbox.send(Clip("walk")), 50, here)
    after = source.window(50, 200)
    assert after is not None and len(after) == 105
    np.testing.assert_allclose(after.root_position[0, :2], here.root_position[0, :2], atol=1e-12)
    np.testing.assert_allclose(heading(after.root_quaternion[0]), heading(here.root_quaternion[0]), atol=1e-9)
    assert source.window(154, 30) is None  # it is over


def test_a_clip_after_the_end_of_another_begins_at_its_last_frame() -> None:
    source, mailbox = library(), TargetMailbox()
    source.turn_to(mailbox.send(Clip("walk")), 500, None)
    after = source.window(500, 10)
    last = default_clip()[119:120]
    assert after is not None
    np.testing.assert_allclose(after.root_position[0, :2], last.root_position[0, :2], atol=1e-12)


def test_an_unknown_clip_is_refused_with_what_there_is() -> None:
    with pytest.raises(ConfigError, match="unknown clip 'fly', expected one of: walk, wave"):
        library().turn_to(TargetMailbox().send(Clip("fly")), 0, None)
    with pytest.raises(ConfigError, match="unknown clip 'fly'"):
        ClipLibrary({"wave": default_clip()}, "fly")


@pytest.mark.parametrize("intent", [Text("wave"), Velocity(0.5, 0.0, 0.0), Stop()])
def test_a_library_refuses_what_only_a_model_can_follow(intent: Intent) -> None:
    with pytest.raises(ConfigError, match="cannot be followed, only clips are played here"):
        library().turn_to(TargetMailbox().send(intent), 0, None)
