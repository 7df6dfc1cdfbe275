"""Newton-Euler equations against MuJoCo's inverse dynamics."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from flexmotion.biomechanics.inverse_dynamics import effort, joint_torques, whole_effort
from flexmotion.biomechanics.segment_motion import segment_motion
from flexmotion.biomechanics.smoothing import smooth
from flexmotion.human.human_model import human_model
from flexmotion.human.motion import Motion
from flexmotion.human.resample import resample

FPS = 240.0


@pytest.fixture(scope="module")
def fine_clip(clip: Motion) -> Motion:
    return smooth(resample(clip, FPS))


def no_ground(motion: Motion) -> tuple[np.ndarray, np.ndarray]:
    return np.zeros((len(motion), 2, 6)), np.zeros((len(motion), 2, 3))


def test_agrees_with_mujoco(fine_clip: Motion) -> None:
    human = human_model(fine_clip.body)
    data, qpos = mujoco.MjData(human.model), human.qpos(fine_clip)
    velocity = np.zeros((len(qpos), human.model.nv))
    for frame in range(1, len(qpos) - 1):
        mujoco.mj_differentiatePos(human.model, velocity[frame], 2 / FPS, qpos[frame - 1], qpos[frame + 1])
    acceleration = np.gradient(velocity, axis=0) * FPS
    torques = joint_torques(fine_clip.body, segment_motion(fine_clip), *no_ground(fine_clip))
    for frame in range(20, len(qpos) - 20, 37):
        data.qpos[:], data.qvel[:], data.qacc[:] = qpos[frame], velocity[frame], acceleration[frame]
        mujoco.mj_inverse(human.model, data)
        assert torques[frame] == pytest.approx(data.qfrc_inverse[human.dof_index], abs=0.6)


def test_the_whole_effort_is_the_sum_of_that_of_the_segments(fine_clip: Motion) -> None:
    segments = segment_motion(fine_clip)
    expected = effort(segments, fine_clip.body).about(np.zeros((len(segments), 3))) / fine_clip.body.mass
    force, moment, centre = whole_effort(segments)
    np.testing.assert_allclose(np.concatenate([force, moment], axis=1), expected, rtol=1e-12, atol=1e-10)
    np.testing.assert_allclose(centre, segments.centre, rtol=1e-12, atol=1e-12)


def test_wrench_at_a_foot_acts_as_in_mujoco(fine_clip: Motion) -> None:
    human = human_model(fine_clip.body)
    data, motion = mujoco.MjData(human.model), fine_clip[1000:1010]
    segments = segment_motion(motion)
    wrenches, points = no_ground(motion)
    wrenches[:, 0] = [30.0, -20.0, 400.0, 3.0, 5.0, -2.0]
    points[:] = [0.3, 0.1, 0.0]
    change = joint_torques(motion.body, segments, wrenches, points) - joint_torques(
        motion.body, segments, *no_ground(motion)
    )
    data.qpos[:] = human.qpos(motion)[4]
    mujoco.mj_kinematics(human.model, data)
    mujoco.mj_comPos(human.model, data)
    applied = np.zeros(human.model.nv)
    foot = human.body_index["calcaneus_l"]
    mujoco.mj_applyFT(human.model, data, wrenches[4, 0, :3], wrenches[4, 0, 3:], points[4, 0], foot, applied)
    assert change[4] == pytest.approx(-applied[human.dof_index], abs=1e-6)
