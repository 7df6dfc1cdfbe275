"""From a file to motion: conventions, fidelity, faults. The files are written from a motion that is known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from flexmotion.configs.errors import MotionFormatError
from flexmotion.human.body import Body, Segments
from flexmotion.human.kinematics import forward
from flexmotion.human.motion_file import save_motion
from flexmotion.human.skeleton import JOINTS
from flexmotion.importers import load, read
from flexmotion.importers.bvh import read_bvh
from flexmotion.importers.fit import fit
from flexmotion.importers.landmarks import landmarks
from flexmotion.importers.mapping import find_mapping
from flexmotion.spatial.heading import matrix_heading

POINTS = ("hip", "knee", "ankle", "heel", "toe", "shoulder", "elbow", "wrist", "hand")


def distance(first, second, points=POINTS):
    """Largest distance of the same points of two motions, root at the same place [m]."""
    a, b = forward(first), forward(second)
    shift = a.pelvis_position[:1] - b.pelvis_position[:1]
    return {
        name: np.linalg.norm(getattr(a, name) - getattr(b, name) - shift[:, None], axis=-1).max() for name in points
    }


@pytest.mark.parametrize(
    "options",
    [
        {"up": "y", "scale": 100.0},
        {"up": "z", "scale": 1.0},
        {"up": "y", "scale": 39.3701},
        {"up": "z", "scale": 1000.0},
        {"up": "y", "scale": 100.0, "all_positions": True},
        {"up": "y", "scale": 100.0, "leading": 3},
    ],
    ids=str,
)
def test_a_written_motion_is_read_back(clip, write_bvh, tmp_path, options):
    result = read(write_bvh(tmp_path / "clip.bvh", clip, **options))
    motion = result.motion
    assert result.mapping == "guess"
    assert len(motion) == len(clip)
    error = distance(motion, clip)
    assert max(error.values()) < 5e-3, error
    assert result.errors["ankle"].max < 1e-3
    assert result.errors["wrist"].max < 1e-3
    assert result.errors["head"].max < 2e-2
    assert motion.body.height == pytest.approx(1.75, abs=0.01)
    angles = np.abs(motion.joints - clip.joints).max(axis=0)
    assert angles.max() < 0.1, JOINTS[angles.argmax()]


def test_it_starts_over_the_origin_facing_x_on_the_floor(clip, write_bvh, tmp_path):
    turn = Rotation.from_euler("z", 2.0)
    quaternion = (turn * Rotation.from_quat(clip.root_quaternion, scalar_first=True)).as_quat(scalar_first=True)
    moved = replace(clip, root_position=turn.apply(clip.root_position) + [3.0, -2.0, 0.4], root_quaternion=quaternion)
    motion = load(write_bvh(tmp_path / "clip.bvh", moved))
    assert motion.root_position[0, :2] == pytest.approx([0, 0])
    assert matrix_heading(forward(motion).pelvis_rotation[0]) == pytest.approx(0, abs=1e-6)
    assert np.median(forward(motion).heel[..., 2]) == pytest.approx(0, abs=3e-3)
    # Heading and position change, the shape of the path does not.
    assert np.linalg.norm(motion.root_position[-1] - motion.root_position[0]) == pytest.approx(
        np.linalg.norm(clip.root_position[-1] - clip.root_position[0]), abs=0.01
    )


def test_units_and_axis_can_be_given(clip, write_bvh, tmp_path):
    path = write_bvh(tmp_path / "clip.bvh", clip[:40], up="z", scale=100.0)
    assert load(path, units="cm", up="z").body.height == pytest.approx(1.75, abs=0.01)
    with pytest.raises(MotionFormatError, match=r"a leg of 85\.9 m, expected .*other units"):
        load(path, units="m")


def test_sizes_of_no_human_are_refused(clip, write_bvh, tmp_path):
    with pytest.raises(MotionFormatError, match=r"a leg of .* is not a human's in any of m, cm, mm, inch"):
        load(write_bvh(tmp_path / "clip.bvh", clip[:5], scale=4.0))


@pytest.mark.parametrize("fps", [120.0, 60.0])
def test_faster_recordings_are_resampled_to_thirty(make_standing, write_bvh, tmp_path, fps):
    time = np.arange(int(3 * fps) + 1) / fps
    motion = make_standing(len(time), fps=fps)
    joints = motion.joints.copy()
    joints[:, JOINTS.index("elbow_flexion_l")] = 0.8 + 0.5 * np.sin(2 * np.pi * time)
    motion = replace(motion, joints=joints)
    slow = load(write_bvh(tmp_path / "clip.bvh", motion))
    assert slow.fps == 30.0
    assert len(slow) == 91
    elbow = slow.joints[:, JOINTS.index("elbow_flexion_l")]
    np.testing.assert_allclose(elbow, 0.8 + 0.5 * np.sin(2 * np.pi * np.arange(91) / 30), atol=0.02)
    assert load(tmp_path / "clip.bvh", fps=None).fps == pytest.approx(fps, rel=1e-5)


def test_a_t_pose_and_the_transition_from_it_are_dropped(make_standing, write_bvh, tmp_path):
    still = make_standing(60, fps=120.0, elbow_flexion_l=1.2, elbow_flexion_r=1.2)
    joints = still.joints.copy()
    # A filter makes a transition from the zero pose to the motion.
    joints[:5] *= np.array([0.0, 0.25, 0.6, 0.85, 0.97])[:, None]
    motion = load(write_bvh(tmp_path / "clip.bvh", replace(still, joints=joints)), fps=None)
    assert len(still) - 10 <= len(motion) <= len(still) - 4
    assert motion.joints[:, JOINTS.index("elbow_flexion_l")] == pytest.approx(1.2, abs=0.01)


def test_without_orientations_positions_suffice(clip, write_bvh, tmp_path):
    """As joint-centre formats give it: no rotations at all."""
    capture = read_bvh(write_bvh(tmp_path / "clip.bvh", clip))
    mapping = find_mapping(capture.names, capture.path)
    bare = landmarks(replace(capture, rotations=None), mapping)
    result = fit(bare)
    error = distance(result.motion, clip, ("ankle", "knee", "wrist", "elbow"))
    assert max(error.values()) < 0.03, error
    assert result.errors["ankle"].max < 2e-3
    speed = np.abs(np.diff(result.motion.joints, axis=0)).max() * clip.fps
    assert speed < 20


def test_a_skeleton_that_does_not_stand_at_zero(clip, write_bvh, tmp_path):
    """Bones folded away at zero rotation: segment axes must then come from the positions."""
    capture = read_bvh(write_bvh(tmp_path / "clip.bvh", clip))
    folded = replace(capture, zero_positions=capture.zero_positions[:, [1, 0, 2]])
    found = landmarks(folded, find_mapping(capture.names, capture.path))
    assert not found.orientations
    assert fit(found).errors["ankle"].max < 2e-3


def test_uneven_legs_and_turned_out_feet(write_bvh, make_standing, tmp_path):
    body = Body(1.75, fitted=replace(Segments.of_height(1.75), toe_out=0.25))
    angles = {
        f"{joint}_{s}": a
        for s in "lr"
        for joint, a in (("hip_flexion", 0.3), ("knee_flexion", 0.6), ("ankle_dorsiflexion", 0.3))
    }
    motion = make_standing(30, body=body, **angles)
    motion = replace(motion, root_position=motion.root_position - [0, 0, 0.05])
    result = load(write_bvh(tmp_path / "clip.bvh", motion))
    assert result.body.segments.toe_out == pytest.approx(0.25, abs=0.02)
    foot = forward(result).foot_rotation[0]
    assert matrix_heading(foot) == pytest.approx([0.25, -0.25], abs=0.03)
    assert foot[:, 2, 0] == pytest.approx([0, 0], abs=0.02)


def test_quaternions_keep_their_sign_and_angles_do_not_jump(make_standing, write_bvh, tmp_path):
    motion = make_standing(200)
    yaw = np.linspace(0, 5 * np.pi, 200)
    quaternion = Rotation.from_euler("z", yaw[:, None]).as_quat(scalar_first=True)
    result = load(write_bvh(tmp_path / "clip.bvh", replace(motion, root_quaternion=quaternion)))
    assert np.abs(np.diff(result.root_quaternion, axis=0)).max() < 0.1
    assert np.abs(np.diff(result.joints, axis=0)).max() < 0.05


def test_our_own_files(clip, tmp_path):
    save_motion(clip, tmp_path / "clip.npz")
    np.testing.assert_array_equal(load(tmp_path / "clip.npz").joints, clip.joints)
    assert load(tmp_path / "clip.npz", fps=60).fps == 60


@pytest.mark.parametrize("name", ["clip.fbx", "clip"])
def test_unknown_kinds(tmp_path, name):
    with pytest.raises(
        MotionFormatError, match=r"unknown kind of motion file, expected \.bvh, \.amc, \.npy, \.trc, \.c3d, \.npz"
    ):
        load(tmp_path / name)


def test_one_frame(clip, write_bvh, tmp_path):
    assert len(load(write_bvh(tmp_path / "clip.bvh", clip[:1]))) == 1


CMU = ("06_04", "07_09", "14_05", "14_37")
BANDAI = ("dataset-2_walk_active_024", "dataset-1_walk-left_tired_001", "dataset-2_wave-right-hand_masculine_009")


@pytest.mark.parametrize("collection", ["cmu", "bandai"])
def test_recorded_clips(shared_clips, collection):
    for path in shared_clips(collection, *(CMU if collection == "cmu" else BANDAI)):
        result = read(path)
        assert result.mapping == collection
        assert result.motion.fps == 30.0
        assert result.errors["ankle"].max < 2e-3
        assert result.errors["wrist"].max < 0.02
        assert result.errors["head"].rms < 0.04
        human = forward(result.motion)
        lowest = np.minimum(human.heel[..., 2], human.toe[..., 2]).min(axis=1)
        assert np.median(lowest) == pytest.approx(0, abs=0.02)
        assert np.abs(np.diff(result.motion.joints, axis=0)).max() < 1.2
