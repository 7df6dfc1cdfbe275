"""An arm that is moved by its own joints is where forward kinematics of the whole body have it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from flexmotion.features.decode import Anchor
from flexmotion.features.layout import POINTS
from flexmotion.human.motion import Motion
from flexmotion.human.skeleton import JOINTS
from flexmotion.sampling.arm_closing import CARRIED, MOVED, PLACED
from flexmotion.sampling.arm_pose import ArmPose
from flexmotion.sampling.window_pose import WindowPose


@pytest.mark.parametrize("side", ["l", "r"])
def test_an_arm_moves_as_with_the_whole_body(clip: Motion, side: str) -> None:
    motion, anchor = clip[60:92].kinematics, Anchor.after(clip[59:60])
    points = [POINTS.index(f"{point}_{side}") for point in PLACED]
    columns = [JOINTS.index(f"{joint}_{side}") for joint in MOVED]

    def arm(of: Motion) -> ArmPose:
        pose = WindowPose.of(of, anchor)
        return ArmPose(pose.anchor[:, columns], pose.axis[:, columns], pose.points[:, points], CARRIED)

    change = np.random.default_rng(3).uniform(-0.8, 0.8, (len(motion), len(columns)))
    joints = motion.joints.copy()
    joints[:, columns] += change
    found, expected = arm(motion).moved(change), arm(replace(motion, joints=joints))
    assert found.points == pytest.approx(expected.points, abs=1e-9)
    assert found.anchor == pytest.approx(expected.anchor, abs=1e-9)
    assert found.axis == pytest.approx(expected.axis, abs=1e-9)
