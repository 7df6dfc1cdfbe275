"""Arms that stay in the pose that they reached."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from flexmotion.features.constraint_layout import ROTATIONS
from flexmotion.features.constraints import Constraints
from flexmotion.features.layout import Layout
from flexmotion.human.motion import Motion
from flexmotion.human.skeleton import JOINTS
from flexmotion.sampling.kept_pose import ARRIVED, KEYFRAMES, KeptPose

ELBOW = JOINTS.index("elbow_flexion_r")


def bending(motion: Motion, angles: np.ndarray) -> Motion:
    joints = motion.joints.copy()
    joints[:, ELBOW] = angles
    return replace(motion, joints=joints)


def test_the_pose_is_where_the_arms_were_farthest_from_where_they_began(make_standing: Callable[..., Motion]) -> None:
    angles = np.concatenate([np.linspace(0.2, 1.8, 20), np.linspace(1.7, 0.3, 12)])
    pose = KeptPose.reached(bending(make_standing(32), angles))
    assert pose is not None and pose.frame == 19 and pose.joints[ELBOW] == pytest.approx(1.8)


def test_arms_that_are_still_on_their_way_have_no_pose_yet(make_standing: Callable[..., Motion]) -> None:
    """A slow hand was held half way up."""
    assert KeptPose.reached(bending(make_standing(32), np.linspace(0.2, 1.8, 32))) is None
    angles = np.concatenate([np.linspace(0.2, 1.8, 32 - ARRIVED), np.full(ARRIVED, 1.7)])
    assert KeptPose.reached(bending(make_standing(32), angles)) is not None


def test_only_arms_are_asked_for_and_only_after_the_pose(make_standing: Callable[..., Motion]) -> None:
    motion = make_standing(32, elbow_flexion_r=1.2)
    free = Constraints.none(Layout(motion.fps), motion.body, 32)
    pose = KeptPose(motion.joints[0], 15)
    asked = pose.asked(free)
    frames, columns = np.nonzero(asked.mask)
    assert len(set(frames)) == KEYFRAMES and max(frames) == 31
    assert len(set(columns)) == 2 * (6 + 1)  # both shoulders and elbows
    rotations = asked.layout.blocks[ROTATIONS]
    assert all(rotations.start <= column < rotations.stop for column in columns)
    assert min(np.nonzero(pose.asked(free, after=15).mask)[0]) > 15
