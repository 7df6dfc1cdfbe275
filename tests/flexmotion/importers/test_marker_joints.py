"""Joint centres from surface markers, on a human whose joint centres are known."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from benchmarks.shared.clips import data_folder
from flexmotion.configs.errors import ConfigError
from flexmotion.human.motion import Motion
from flexmotion.importers.mapping import find_mapping
from flexmotion.importers.marker_capture import joint_capture
from flexmotion.importers.rigid import cluster_pose, common_points
from flexmotion.importers.trc import read_trc

from .surface_markers import Tracks, joint_centres, surface_markers, write_trc

# Root mean square errors that are accepted [m], by point. The human has the pelvis of the regression's mean; its ankle
# lies in a foot of other proportions, and its neck and shoulders are placed by means of adults.
LIMITS = {"Hip": 0.003, "Knee": 0.012, "Ankle": 0.02, "Toe": 0.015, "Neck": 0.05, "Shoulder": 0.05}


def errors(path: Path, truth: Tracks) -> dict[str, float]:
    capture = read_trc(path)
    found = joint_capture(capture, find_mapping(capture.names, str(path)))
    out = {}
    for name, track in truth.items():
        side = {"L": "_l", "R": "_r"}.get(name[0], "") if name[0] in "LR" else ""
        point = name.removeprefix("Left").removeprefix("Right").lower() + side
        if point in found.names:
            difference = found.positions[:, found.names.index(point)] - track
            out[name] = float(np.sqrt((difference**2).sum(axis=-1).mean()))
    return out


@pytest.mark.parametrize("kind", ["plug_in_gait", "gait2354"])
def test_joint_centres_of_a_known_human(kind: str, tmp_path: Path, clip: Motion) -> None:
    truth = joint_centres(clip)
    found = errors(write_trc(tmp_path / "a.trc", surface_markers(clip)[kind]), truth)
    assert set(truth) - set(found) <= {"Spine"}
    for name, error in found.items():
        limit = LIMITS.get(name.removeprefix("Left").removeprefix("Right"), 0.06)
        assert error < limit, f"{name}: {1e3 * error:.0f} mm"


def test_medial_markers_are_used(tmp_path: Path, clip: Motion) -> None:
    truth, markers = joint_centres(clip), surface_markers(clip)["plug_in_gait"]
    for side, name in (("L", "Left"), ("R", "Right")):
        markers[f"{side}KNM"] = 2 * truth[f"{name}Knee"] - markers[f"{side}KNE"]
        markers[f"{side}MED"] = 2 * truth[f"{name}Ankle"] - markers[f"{side}ANK"]
    found = errors(write_trc(tmp_path / "a.trc", markers), truth)
    for joint in ("LeftKnee", "RightKnee", "LeftAnkle", "RightAnkle"):
        assert found[joint] < 1e-4


def test_cluster_pose_and_joint_of_two_clusters() -> None:
    from scipy.spatial.transform import Rotation

    rng = np.random.default_rng(0)
    shape, joint = rng.normal(0, 0.1, (4, 3)), np.array([0.1, 0.2, -0.3])
    first = Rotation.from_rotvec(rng.normal(0, 0.3, (40, 3)))
    hinge = Rotation.from_rotvec(np.linspace(0, 1, 40)[:, None] * [0.0, 1.0, 0.0])
    origin = rng.normal(0, 1, (40, 3))
    second = first * hinge
    end = origin + first.apply(joint) - second.apply(-joint)
    upper = np.stack([origin + first.apply(point) for point in shape], axis=1)
    lower = np.stack([end + second.apply(point) for point in shape], axis=1)
    upper[5, 0] = np.nan
    poses = cluster_pose(upper), cluster_pose(lower)
    assert all(np.isfinite(pose[0]).all() for pose in poses)
    one, two, axis, other = common_points(*(pose[:2] for pose in poses))
    (r1, t1, _), (r2, t2, _) = poses
    difference = (t1 + r1 @ one) - (t2 + r2 @ two)
    assert np.abs(difference).max() < 1e-9
    line = first.apply([0.0, 1.0, 0.0])
    assert np.abs(np.abs(np.einsum("ti,ti->t", r1 @ axis, line)) - 1).max() < 1e-9
    assert np.abs(np.abs(np.einsum("ti,ti->t", r2 @ other, line)) - 1).max() < 1e-9
    off = (t1 + r1 @ one) - (origin + first.apply(joint))
    assert np.abs(np.cross(off, line)).max() < 1e-9


def test_two_markers_have_no_pose() -> None:
    rotation, _, _ = cluster_pose(np.random.default_rng(0).normal(size=(5, 2, 3)))
    assert np.isnan(rotation).all()


def test_regression_against_the_centres_of_a_laboratory() -> None:
    """The walking trial has no marker on knees and ankles; the reference is a model scaled to its static trial."""
    try:
        folder = data_folder()
    except ConfigError:
        pytest.skip("needs the motion data")
    truth = read_trc(folder / "gait2354_joint_centres.trc")
    first = round(truth.start * truth.fps)
    capture = read_trc(folder / "gait2354_markers.trc")
    found = joint_capture(capture, find_mapping(capture.names, capture.path))
    turn = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    for joint in ("Hip", "Knee", "Ankle", "Toe"):
        for side, name in (("l", "Left"), ("r", "Right")):
            mine = found.positions[first : first + len(truth), found.names.index(f"{joint.lower()}_{side}")]
            theirs = truth.positions[:, truth.names.index(name + joint)] @ turn.T
            assert np.sqrt(((mine - theirs) ** 2).sum(axis=-1).mean()) < 0.04, name + joint
