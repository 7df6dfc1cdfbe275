"""Forward kinematics."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from flexmotion.human.human_model import human_model
from flexmotion.human.kinematics import STATE, foot_points, forward, frame_arrays


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


def test_poses_are_mujocos(clip):
    human, state = human_model(clip.body), frame_arrays(clip, *STATE)
    data = mujoco.MjData(human.model)
    for frame in (0, 60, 185, 270):
        data.qpos[:] = human.qpos(clip)[frame]
        mujoco.mj_kinematics(human.model, data)
        for name, found in zip(STATE, state, strict=True):
            assert found[frame] == pytest.approx(getattr(data, name), abs=1e-13), name


def test_foot_points_alone_are_those_of_all_segments(clip, clip_kinematics):
    np.testing.assert_array_equal(foot_points(clip), np.stack([clip_kinematics.heel, clip_kinematics.toe], axis=2))


def test_unknown_arrays_are_refused(clip):
    with pytest.raises(ValueError, match="xvel"):
        frame_arrays(clip, "xpos", "xvel")


def test_a_pelvis_without_a_rotation_is_upright(clip):
    """As MuJoCo takes it; a quaternion of zeros made all positions NaN."""
    none, upright = (
        frame_arrays(clip[:3].changed(root_quaternion=np.tile(turn, (3, 1))), *STATE)
        for turn in ([0.0, 0.0, 0.0, 0.0], [1.0, 0.0, 0.0, 0.0])
    )
    for found, expected in zip(none, upright, strict=True):
        np.testing.assert_array_equal(found, expected)
