"""Segments after a few joints of the last frames have changed are those of the whole motion."""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np
import pytest

from flexmotion.biomechanics.segment_motion import moved_by, segment_motion
from flexmotion.human.motion import Motion
from flexmotion.human.resample import resample
from flexmotion.human.skeleton import JOINTS


@pytest.mark.parametrize("first", [0, 12])
@pytest.mark.parametrize(
    "moved", [[], ["elbow_flexion_r"], ["hip_flexion_l", "shoulder_flexion_r"], ["lumbar_bending"]]
)
def test_only_what_moved_joints_carry_changes(clip: Motion, moved: list[str], first: int) -> None:
    motion = resample(clip, 30.0)[60:100].kinematics
    columns = np.isin(JOINTS, moved)
    joints = motion.joints.copy()
    joints[first:, columns] += 0.2 * np.sin(np.arange(len(motion) - first))[:, None]
    changed = replace(motion, joints=joints)
    found, expected = moved_by(columns, segment_motion(motion), changed[first:]), segment_motion(changed)
    for item in fields(expected):
        np.testing.assert_allclose(getattr(found, item.name), getattr(expected, item.name), atol=1e-9)
