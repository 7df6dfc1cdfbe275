"""Forward kinematics and headings."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from flexmotion.human.human_model import human_model
from flexmotion.human.kinematics import continuous_heading, forward, heading


def test_centre_of_mass_is_mujocos(clip, clip_kinematics):
    human = human_model(clip.body)
    data = mujoco.MjData(human.model)
    for frame in (0, 60, 185, 270):
        data.qpos[:] = human.qpos(clip)[frame]
        mujoco.mj_fwdPosition(human.model, data)
        assert clip_kinematics.com[frame] == pytest.approx(data.subtree_com[1], abs=1e-12)


def test_chunks_make_the_whole(clip, clip_kinematics):
    parts = forward(clip[:100]) + forward(clip[100:])
    assert len(parts) == len(clip)
    np.testing.assert_array_equal(parts.toe, clip_kinematics.toe)
    np.testing.assert_array_equal(parts[5:9].com, clip_kinematics.com[5:9])


def test_no_frames(clip):
    assert len(forward(clip[:0])) == 0


def test_bones_keep_their_length(clip, clip_kinematics):
    size = clip.body.segments
    for first, second, length in (
        ("hip", "knee", size.thigh),
        ("knee", "ankle", size.shank),
        ("wrist", "hand", size.hand),
    ):
        distance = np.linalg.norm(getattr(clip_kinematics, first) - getattr(clip_kinematics, second), axis=-1)
        assert distance == pytest.approx(np.full(distance.shape, length))


@pytest.mark.parametrize("yaw", [-3.0, -1.0, 0.0, 2.0])
@pytest.mark.parametrize("pitch", [0.0, 0.8, 1.7])
def test_heading_survives_a_deep_bow(yaw, pitch):
    rotation = Rotation.from_euler("ZY", [yaw, pitch]).as_matrix()
    assert heading(rotation) == pytest.approx(yaw)


def test_continuous_heading_counts_turns():
    yaw = np.linspace(0, 5 * np.pi, 60)
    rotation = Rotation.from_euler("z", yaw[:, None]).as_matrix()
    np.testing.assert_allclose(continuous_heading(rotation), yaw, atol=1e-9)
    np.testing.assert_allclose(continuous_heading(rotation, start=6.2), yaw + 2 * np.pi, atol=1e-9)
