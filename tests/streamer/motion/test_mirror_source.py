from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from flexmotion.configs.errors import ConfigError
from flexmotion.human.motion import Motion
from flexmotion.human.resample import resample
from flexmotion.spatial.heading import heading
from flexmotion.streamer.commands.choice import choose_motion
from flexmotion.streamer.motion.intents import Text, Velocity
from flexmotion.streamer.motion.mirror_source import SILENT_S, MirrorSource
from flexmotion.streamer.motion.person_channel import FPS, PersonChannel, PersonPose, pose_of
from flexmotion.streamer.motion.targets import Target


@pytest.fixture(scope="module")
def clip() -> Motion:
    return resample(choose_motion(), FPS)


def show(channel: PersonChannel, clip: Motion, first: int, last: int, stream: int = 1, at: int = 0) -> None:
    for frame in range(first, last):
        time_s = (at + frame) / FPS
        channel.publish(PersonPose(stream, time_s, time_s + 0.01, clip[frame : frame + 1]))


def test_a_pose_goes_through_shared_memory_unchanged(clip):
    channel = PersonChannel()
    reader = channel.reader()
    show(channel, clip, 3, 4)
    pose = pose_of(reader.read()[0])
    np.testing.assert_array_equal(pose.motion.joints, clip[3:4].joints)
    assert pose.motion.body.segments == clip.body.segments and pose.stream == 1


def begun(clip: Motion, frames: int = 30) -> tuple[MirrorSource, PersonChannel]:
    channel = PersonChannel()
    source = MirrorSource(channel)
    show(channel, clip, 0, frames)
    source.update(frames / FPS)
    assert source.wanted and source.resting
    source.begin(0, None, None)
    source.align(0.0)
    return source, channel


def test_a_frame_shows_the_person_at_its_time(clip):
    source, _ = begun(clip)
    window = source.window(10, 15)
    np.testing.assert_allclose(window.joints, clip[10:25].joints, atol=1e-9)
    source.align(-0.5 / FPS)  # frame 0 is half a frame earlier
    between = source.window(10, 2)
    np.testing.assert_allclose(between.joints[0], 0.5 * (clip.joints[9] + clip.joints[10]), atol=1e-9)


def test_the_person_begins_where_the_robots_human_stands(clip):
    channel = PersonChannel()
    source = MirrorSource(channel)
    show(channel, clip, 0, 30)
    source.update(1.0)
    played = replace(clip[:3], root_position=clip[:3].root_position + [2.0, 1.0, 0.0])
    source.begin(0, played)
    source.align(0.0)
    pose = source.window(29, 2)
    np.testing.assert_allclose(pose.root_position[0, :2], played.root_position[-1, :2], atol=1e-9)
    source.begin(0, None, 0.7)
    assert heading(source.window(29, 2).root_quaternion[0]) == pytest.approx(0.7)


def test_the_time_between_frames_is_known_after_a_few_and_one_that_is_lost_does_not_change_it(clip):
    channel = PersonChannel()
    source = MirrorSource(channel)
    assert np.isnan(source.between_s)
    show(channel, clip, 0, 6)
    show(channel, clip, 7, 10)
    source.update(0.4)
    assert source.between_s == pytest.approx(1.0 / FPS)
    # A slow frame completes several poses at once.
    for frame in range(10, 30, 2):
        for pose in (frame, frame + 1):
            channel.publish(PersonPose(1, pose / FPS, frame / FPS + 0.1, clip[pose : pose + 1]))
    source.update(1.1)
    assert source.between_s == pytest.approx(2.0 / FPS)


def test_a_silent_person_is_followed_no_longer_and_one_who_comes_back_is(clip):
    source, channel = begun(clip)
    source.update(30 / FPS + SILENT_S - 0.05)
    assert not source.resting and source.window(30, 5) is not None
    source.update(30 / FPS + SILENT_S + 0.05)
    assert source.resting and not source.wanted and source.window(30, 5) is None
    show(channel, clip, 0, 3, stream=2, at=60)
    source.update(63 / FPS)
    assert not source.wanted  # three poses say no speed
    show(channel, clip, 3, 10, stream=2, at=60)
    source.update(70 / FPS)
    assert source.wanted and source.resting


def test_a_new_stream_is_begun_anew(clip):
    source, channel = begun(clip)
    show(channel, clip, 0, 10, stream=2, at=30)
    source.update(40 / FPS)
    assert source.resting and source.wanted


def test_nothing_grows(clip):
    source, channel = begun(clip)
    for turn in range(1, 8):
        show(channel, clip, 0, 30, at=30 * turn)
        source.update(30 * (turn + 1) / FPS)
        source.window(30 * (turn + 1), 35)
    assert len(source._poses) <= 60


def test_targets(clip):
    source, _ = begun(clip)
    with pytest.raises(ConfigError, match="velocity cannot be followed"):
        source.turn_to(Target(1, 0, Velocity(0.1, 0.0, 0.0)), 0, None)
    assert source.turn_to(Target(2, 0, Text("Mirror")), 0, None) is None
    empty = MirrorSource(PersonChannel())
    with pytest.raises(ConfigError, match="nobody is seen"):
        empty.turn_to(Target(3, 0, Text("mirror")), 0, None)
