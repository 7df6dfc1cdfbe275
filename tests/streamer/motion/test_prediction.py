"""What a person does next, as foreseen."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from flexmotion.human.body import Body
from flexmotion.human.concatenate import concatenate
from flexmotion.human.kinematics import forward
from flexmotion.human.motion import Motion
from flexmotion.human.resample import resample
from flexmotion.streamer.api import open_sampler
from flexmotion.streamer.commands.choice import choose_motion
from flexmotion.streamer.motion import prediction
from flexmotion.streamer.motion.person_channel import FPS
from flexmotion.streamer.motion.prediction import HeldSpeed, ModelPrediction


@pytest.fixture(scope="module")
def clip() -> Motion:
    return resample(choose_motion(), FPS)


@pytest.fixture(scope="module")
def foresee() -> ModelPrediction:
    return ModelPrediction(open_sampler())


def raised(motion: Motion, up_m: float) -> Motion:
    return replace(motion, root_position=motion.root_position + [0.0, 0.0, up_m])


def test_a_held_speed_dies_away(clip):
    history = clip[20:40]
    speed = (history.root_position[-1] - history.root_position[-4]) * FPS / 3.0
    ahead = HeldSpeed(FPS, dies_s=0.3)(history, 90)
    np.testing.assert_allclose(ahead.root_position[-1], history.root_position[-1] + 0.3 * speed, atol=1e-4)
    assert len(HeldSpeed(FPS)(history[:1], 5)) == 5  # of one pose no speed is known


def test_the_model_goes_on_from_the_person_whatever_the_size(clip, foresee):
    body = Body(1.5, 50.0)
    scale = body.leg / clip.body.leg
    child = replace(clip[:40], body=body, root_position=scale * clip[:40].root_position)
    ahead = foresee(child, 50)
    assert len(ahead) == 50 and ahead.body == body
    assert np.linalg.norm(ahead.root_position[0] - child.root_position[-1]) < 0.08
    human = forward(ahead)
    assert np.minimum(human.heel[..., 2], human.toe[..., 2]).min() > -0.1
    again = foresee(child, 50)
    np.testing.assert_array_equal(ahead.joints, again.joints)


def test_a_walker_whose_pelvis_turns_to_and_fro_is_foreseen_straight_ahead(clip, foresee):
    # Measured over a third of a second the pelvis turned by up to 2 rad/s: the model was asked to turn as fast.
    still = clip[:1]
    time_s = np.arange(60) / FPS
    sway = 0.2 * np.sin(2.0 * np.pi * time_s / prediction.STRIDE_S)
    walk = replace(
        still,
        root_position=still.root_position + np.outer(time_s, [1.0, 0.0, 0.0]),
        root_quaternion=Rotation.from_euler("z", sway[:, None]).as_quat(scalar_first=True),
        joints=np.repeat(still.joints, 60, axis=0),
    )
    for last in range(45, 60):
        forward, left, turning = prediction._velocity(walk[:last])
        assert abs(turning) < 0.1 and abs(left) < 0.1 and forward == pytest.approx(1.0, abs=0.05)


def test_a_person_who_jumps_across_the_room_is_foreseen(clip, foresee):
    """Frames of a tracker that jump are of any speed: more than a model can be asked for would end the planner."""
    away = np.where(np.arange(40)[:, None] >= 35, [30.0, 0.0, 0.0], 0.0)
    ahead = foresee(replace(clip[:40], root_position=clip[:40].root_position + away), 30)
    assert len(ahead) == 30 and np.isfinite(ahead.root_position).all()


def test_who_stands_on_a_ladder_is_not_foreseen_on_the_floor(clip, foresee):
    # The model has learnt from humans on a floor at z = 0: a person .85 m up was foreseen .5 m lower within .3 s.
    standing = raised(concatenate([clip[:1]] * foresee.remembers), 0.85)
    ahead = foresee(standing, 30)
    assert np.abs(ahead.root_position - standing.root_position[-1]).max() < 0.1
    assert forward(ahead).toe[..., 2].min() > 0.8


@settings(max_examples=15, deadline=None)
@given(up_m=st.floats(-2.0, -0.2) | st.floats(0.2, 3.0), begin=st.integers(0, 60))
def test_a_prediction_does_not_depend_on_the_height_of_the_ground(clip, foresee, up_m, begin):
    history = clip[begin : begin + foresee.remembers]
    found, other = foresee(raised(history, 0.3), 40), foresee(raised(history, up_m), 40)
    np.testing.assert_allclose(other.root_position, raised(found, up_m - 0.3).root_position, atol=0.002)
    np.testing.assert_allclose(other.joints, found.joints, atol=0.01)


def test_the_roll_of_soles_on_the_floor_is_no_other_ground(clip, foresee, monkeypatch):
    # Followed to the centimetre it moved steps of a walking person, and a robot that turned with them fell.
    history = clip[20 : 20 + foresee.remembers]
    found = {}
    for height in (0.0, -0.04, 0.05, 0.2):
        monkeypatch.setattr(prediction, "ground_under", lambda human, fps, height=height: height)
        found[height] = foresee(history, 30).root_position
    np.testing.assert_array_equal(found[-0.04], found[0.0])
    np.testing.assert_array_equal(found[0.05], found[0.0])
    assert np.abs(found[0.2] - found[0.0]).max() > 0.02


def test_the_first_frame_foreseen_joins_the_last_one_seen(clip, foresee):
    for begin in range(0, 60, 7):
        history = raised(clip[begin : begin + foresee.remembers], 0.4)
        seam = concatenate([history[len(history) - 1 :], foresee(history, 2)])
        before = history.root_position[-1] - history.root_position[-2]
        assert np.abs(np.diff(seam.root_position, axis=0) - before).max() < 0.02
