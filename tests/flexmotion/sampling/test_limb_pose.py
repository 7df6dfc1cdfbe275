"""A limb that is moved by its own joints is where forward kinematics of the whole body have it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from flexmotion.features.decode import Anchor
from flexmotion.human.motion import Motion
from flexmotion.sampling.limb_closing import ARM, LEG, Limb
from flexmotion.sampling.limb_pose import LimbPose
from flexmotion.sampling.window_pose import WindowPose


@pytest.mark.parametrize("side", ["l", "r"])
@pytest.mark.parametrize("limb", [ARM, LEG])
def test_a_limb_moves_as_with_the_whole_body(clip: Motion, limb: Limb, side: str) -> None:
    motion, anchor = clip[60:92].kinematics, Anchor.after(clip[59:60])
    points, columns = limb.of_points(side), limb.of_joints(side)

    def posed(of: Motion) -> LimbPose:
        pose = WindowPose.of(of, anchor)
        return LimbPose(pose.anchor[:, columns], pose.axis[:, columns], pose.points[:, points], limb.carried)

    change = np.random.default_rng(3).uniform(-0.8, 0.8, (len(motion), len(columns)))
    joints = motion.joints.copy()
    joints[:, columns] += change
    found, expected = posed(motion).moved(change), posed(replace(motion, joints=joints))
    assert found.points == pytest.approx(expected.points, abs=1e-9)
    assert found.anchor == pytest.approx(expected.anchor, abs=1e-9)
    assert found.axis == pytest.approx(expected.axis, abs=1e-9)
