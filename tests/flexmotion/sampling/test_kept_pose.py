"""Arms that stay in the pose that they reached."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from flexmotion.human.motion import Motion
from flexmotion.human.skeleton import JOINTS
from flexmotion.sampling.at_rest import ARMS
from flexmotion.sampling.kept_pose import ARRIVED, KeptPose

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


def test_arms_that_leave_the_pose_are_led_back_and_nothing_else_moves(make_standing: Callable[..., Motion]) -> None:
    """Kept by corrections of the latent, arms took the legs along: standing feet slid by 20 cm/s."""
    angles = np.concatenate([np.linspace(0.2, 1.8, 16), 1.8 - 1.6 * np.linspace(0.0, 1.0, 16) ** 2])
    window = bending(make_standing(32, knee_flexion_l=0.3), angles)
    pose = KeptPose.reached(window)
    assert pose is not None
    kept = pose.kept(window, window)
    assert kept.joints[: pose.frame + 1] == pytest.approx(window.joints[: pose.frame + 1])
    assert kept.joints[pose.frame :, ELBOW].min() > 1.6 > window.joints[-1, ELBOW]
    others = [column for column in range(len(JOINTS)) if column not in ARMS]
    np.testing.assert_array_equal(kept.joints[:, others], window.joints[:, others])
    # Angles and speeds are continuous.
    assert np.abs(np.diff(kept.joints[pose.frame - 1 :, ELBOW], n=2)).max() < 0.11


def test_arms_rest_in_the_pose_in_all_later_windows(make_standing: Callable[..., Motion]) -> None:
    """Every window began to leave the pose and was led back: raised hands jerked by 20 m/s³ at each join."""
    still = make_standing(32)
    pose = KeptPose(bending(still, np.full(32, 1.8)).joints[0], 10).later(32)
    assert pose.frame == -22
    before = bending(make_standing(4), np.array([1.76, 1.77, 1.78, 1.79]))
    window = bending(still, 1.8 - 1.6 * np.linspace(0.0, 1.0, 32) ** 2)
    angles = np.concatenate([before.joints, pose.kept(window, before).joints])[:, ELBOW]
    assert np.abs(angles[4:] - 1.8).max() < 0.1 and np.abs(np.diff(angles, n=2)).max() < 5e-3
    later = pose.later(32).kept(window, bending(make_standing(3), np.full(3, 1.8)))
    assert later.joints[:, ELBOW] == pytest.approx(1.8)
