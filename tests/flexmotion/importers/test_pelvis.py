"""Orientation of the pelvis in files that do not have it.

The line from the hips to the lumbar joint was taken as vertical: hip flexion was 7 to 15 degrees too extended.
"""

from __future__ import annotations

import tarfile
from pathlib import Path

import numpy as np
import pytest

from flexmotion.human.motion import Motion
from flexmotion.human.skeleton import JOINTS
from flexmotion.importers import read

HIPS = [JOINTS.index(f"hip_flexion_{side}") for side in "lr"]


def hip_flexion(motion: Motion) -> np.ndarray:
    """Of both hips, (T, 2) [degrees]."""
    return np.degrees(motion.joints[:, HIPS])


@pytest.mark.parametrize("file", ["gait2354_joint_centres", "gait_second_walk_joint_centres"])
def test_walking_from_joint_centres(file: str, shared_data: Path) -> None:
    """Hips extended by 33 to 36 degrees in walking; 10 to 25 are usual, and flexion peaks at 20 to 40."""
    flexion = hip_flexion(read(shared_data / f"{file}.trc").motion)
    assert -26 < flexion.min() < -8
    assert 18 < flexion.max() < 40


def test_markers_give_the_pelvis(shared_data: Path) -> None:
    """The pelvis that both ASIS and the sacrum show was replaced by the line to the lumbar joint."""
    found = hip_flexion(read(shared_data / "gait2354_markers.trc").motion)
    centres = hip_flexion(read(shared_data / "gait2354_joint_centres.trc").motion)
    assert abs(found.max() - centres.max()) < 9


@pytest.mark.parametrize("clip", ["03_01", "01_01"])
def test_positions_agree_with_rotations_of_the_same_clip(clip: str, shared_data: Path, tmp_path: Path) -> None:
    """Hips from 22 joint positions were 7 to 11 degrees more extended than from the rotations of the same trial."""
    with tarfile.open(shared_data / "cmu_raw.tar.xz") as archive:
        for member in archive:
            if Path(member.name).name in (f"{clip}.amc", f"{clip[:2]}.asf"):
                content = archive.extractfile(member)
                assert content is not None
                (tmp_path / Path(member.name).name).write_bytes(content.read())
    rotations = hip_flexion(read(tmp_path / f"{clip}.amc").motion)
    positions = hip_flexion(read(shared_data / "cmu_joints22_30fps_mm.npz", clip=clip).motion)
    assert np.abs(np.median(positions, axis=0) - np.median(rotations, axis=0)).max() < 6
