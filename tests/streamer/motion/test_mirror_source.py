from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from flexmotion.configs.errors import ConfigError
from flexmotion.human.body import Body
from flexmotion.human.concatenate import concatenate
from flexmotion.human.kinematics import forward
from flexmotion.human.motion import Motion
from flexmotion.human.resample import resample
from flexmotion.spatial.heading import heading
from flexmotion.streamer.api import open_sampler
from flexmotion.streamer.commands.choice import choose_motion
from flexmotion.streamer.motion.intents import Text, Velocity
from flexmotion.streamer.motion.mirror_source import SILENT_S, MirrorSource
from flexmotion.streamer.motion.person_channel import FPS, PersonChannel, PersonPose, pose_of
from flexmotion.streamer.motion.prediction import HeldSpeed, ModelPrediction, ground_of
from flexmotion.streamer.motion.targets import Target


@pytest.fixture(scope="module")
def clip() -> Motion:
    return resample(choose_motion(), FPS)


@pytest.fixture(scope="module")
def foresee() -> ModelPrediction:
    return ModelPrediction(open_sampler())


def raised(motion: Motion, up_m: float) -> Motion:
    return replace(motion, root_position=motion.root_position + [0.0, 0.0, up_m])


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


def test_a_held_speed_dies_away(clip):
    history = clip[20:40]
    speed = (history.root_position[-1] - history.root_position[-4]) * FPS / 3.0
    ahead = HeldSpeed(FPS, dies_s=0.3)(history, 90)
    np.testing.assert_allclose(ahead.root_position[-1], history.root_position[-1] + 0.3 * speed, atol=1e-4)
    assert len(HeldSpeed(FPS)(history[:1], 5)) == 5  # of one pose no speed is known


def test_the_model_goes_on_from_the_person_whatever_the_size(clip, foresee):
    predictor = foresee
    body = Body(1.5, 50.0)
    scale = body.leg / clip.body.leg
    child = replace(clip[:40], body=body, root_position=scale * clip[:40].root_position)
    ahead = predictor(child, 50)
    assert len(ahead) == 50 and ahead.body == body
    assert np.linalg.norm(ahead.root_position[0] - child.root_position[-1]) < 0.08
    human = forward(ahead)
    assert np.minimum(human.heel[..., 2], human.toe[..., 2]).min() > -0.1
    again = predictor(child, 50)
    np.testing.assert_array_equal(ahead.joints, again.joints)


def test_who_stands_on_a_ladder_is_not_foreseen_on_the_floor(clip, foresee):
    # The model has learnt from humans on a floor at z = 0: a person .85 m up was foreseen half a metre lower within .3 s.
    standing = raised(concatenate([clip[:1]] * foresee.remembers), 0.85)
    ahead = foresee(standing, 30)
    assert np.abs(ahead.root_position - standing.root_position[-1]).max() < 0.1
    assert forward(ahead).toe[..., 2].min() > 0.8


def test_who_lies_or_stands_on_the_hands_is_on_the_floor(clip, foresee):
    # Feet in the air are no ground: the person would be given to the model below the floor.
    upside_down = Rotation.from_euler("y", np.pi) * Rotation.from_quat(clip[:1].root_quaternion, scalar_first=True)
    pose = replace(clip[:1], root_quaternion=upside_down.as_quat(scalar_first=True))
    head = forward(pose).vertex[0, 2]
    on_the_head = raised(concatenate([pose] * foresee.remembers), -float(head))
    assert ground_of(on_the_head) == pytest.approx(0.0, abs=1e-9)


def test_the_ground_of_who_jumps_is_where_they_came_from(clip):
    flight = np.array([0.0, 0.0, 0.0, 0.1, 0.17, 0.22, 0.24, 0.23, 0.2, 0.14])
    standing = concatenate([clip[:1]] * len(flight))
    jump = replace(standing, root_position=standing.root_position + flight[:, None] * [0.0, 0.0, 1.0])
    assert ground_of(jump) == pytest.approx(ground_of(standing), abs=1e-9)


@settings(max_examples=15, deadline=None)
@given(up_m=st.floats(-2.0, 3.0), begin=st.integers(0, 60))
def test_a_prediction_does_not_depend_on_the_height_of_the_ground(clip, foresee, up_m, begin):
    history = clip[begin : begin + foresee.remembers]
    found, higher = foresee(history, 40), foresee(raised(history, up_m), 40)
    np.testing.assert_allclose(higher.root_position, raised(found, up_m).root_position, atol=0.002)
    np.testing.assert_allclose(higher.joints, found.joints, atol=0.01)


def test_the_first_frame_foreseen_joins_the_last_one_seen(clip, foresee):
    for begin in range(0, 60, 7):
        history = raised(clip[begin : begin + foresee.remembers], 0.4)
        ahead = foresee(history, 5)
        seam = concatenate([history[len(history) - 1 :], ahead[:2]])
        steps = np.diff(forward(seam).pelvis_position, axis=0)
        before = history.root_position[-1] - history.root_position[-2]
        assert np.abs(steps - before).max() < 0.02  # of a frame: no jump at the seam
