"""One arm of a gesture."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from flexmotion.gestures.arm import PRONATION, arm_angles, hand_in_torso, landmark
from flexmotion.gestures.recipes import ArmPose
from flexmotion.human.angles import three_angles
from flexmotion.human.body import Body
from flexmotion.human.kinematics import HumanKinematics, forward
from flexmotion.human.skeleton import ARM_JOINTS, JOINTS, LEFT, RIGHT, SIDES
from flexmotion.human.vectors import unit

from ...standing_human import standing


def posed(pose: ArmPose, side: int, body: Body) -> HumanKinematics:
    """Kinematics of an upright human with one arm in a pose."""
    motion = standing(0.2, body)
    arm, letter = arm_angles(pose, body, side), SIDES[side]
    shoulder = three_angles(arm.humerus.as_matrix()[None], ARM_JOINTS[:3], letter)[0]
    joints = motion.joints.copy()
    for name, angle in zip(ARM_JOINTS, [*shoulder, arm.elbow, arm.pronation or 0.0], strict=True):
        joints[:, JOINTS.index(f"{name}_{letter}")] = angle
    return forward(replace(motion, joints=joints))


@pytest.mark.parametrize("side", [LEFT, RIGHT])
def test_an_arm_points_where_its_pose_says(side: int) -> None:
    pose = ArmPose(upper=(0.3, 1.0, 0.1), forearm=(1.0, 0.2, 0.4), palm=(0.0, 0.0, -1.0))
    human, body = posed(pose, side, Body()), Body()
    out = [1.0, 1.0 if side == LEFT else -1.0, 1.0]
    upper, forearm = human.elbow[0, side] - human.shoulder[0, side], human.hand[0, side] - human.elbow[0, side]
    np.testing.assert_allclose(unit(upper), unit(np.array([0.3, 1.0, 0.1])) * out, atol=1e-6)
    np.testing.assert_allclose(unit(forearm), unit(np.array([1.0, 0.2, 0.4])) * out, atol=1e-6)
    # The palm is as near to straight down as the forearm's direction lets it be.
    down = np.array([0.0, 0.0, -1.0])
    nearest = unit(down - (down @ unit(forearm)) * unit(forearm))
    np.testing.assert_allclose(human.hand_rotation[0, side, :, 0], nearest, atol=1e-6)
    arm = arm_angles(pose, body, side)
    torso = human.torso_rotation[0].T @ (human.hand[0, side] - human.shoulder[0].mean(axis=0))
    middle = [body.segments.shoulder_forward, 0.0, body.segments.shoulder_height]
    np.testing.assert_allclose(
        hand_in_torso(arm.humerus, np.array(arm.elbow), body, side)[0], torso + middle, atol=1e-6
    )


@pytest.mark.parametrize("height", [1.5, 1.75, 2.0])
@pytest.mark.parametrize("side", [LEFT, RIGHT])
def test_a_hand_reaches_its_landmark_on_every_body(height: float, side: int) -> None:
    pose, body = ArmPose(hand="waist", offset=(0.0, 0.05, 0.0), elbow=(-0.5, 1.0, -0.2)), Body(height)
    arm, out = arm_angles(pose, body, side), 1.0 if side == LEFT else -1.0
    wanted = landmark("waist", body, out) + np.array([0.0, out * 0.05, 0.0]) * height / 1.75
    np.testing.assert_allclose(hand_in_torso(arm.humerus, np.array(arm.elbow), body, side)[0], wanted, atol=1e-6)
    elbow = arm.humerus.apply([0.0, 0.0, -1.0])
    assert out * elbow[1] > 0.3 and elbow[0] < 0.0, "the elbow points outward and back"


def test_a_place_out_of_reach_straightens_the_arm() -> None:
    arm = arm_angles(ArmPose(hand="front", offset=(3.0, 0.0, 0.0), elbow=(0.0, 1.0, -1.0)), Body(), RIGHT)
    assert np.degrees(arm.elbow) == pytest.approx(4.0, abs=0.1)


def test_a_forearm_turns_no_further_than_a_humans() -> None:
    """Palm up with a raised forearm that comes from behind would need 250 degrees."""
    for palm in ((0.0, 0.0, 1.0), (0.0, 0.0, -1.0), (0.0, 1.0, 0.0), (0.0, -1.0, 0.0)):
        arm = arm_angles(ArmPose(upper=(0.2, 1.0, 0.0), forearm=(1.0, 0.3, 0.3), palm=palm), Body(), LEFT)
        assert arm.pronation is not None and PRONATION[0] <= arm.pronation <= PRONATION[1]


def test_drawn_directions_differ_by_their_rotation() -> None:
    pose = ArmPose(upper=(1.0, 0.0, 0.0), forearm=(1.0, 0.0, 0.5))
    turned = arm_angles(pose, Body(), RIGHT, Rotation.from_euler("z", 10, degrees=True))
    np.testing.assert_allclose(
        turned.humerus.apply([0, 0, -1.0]), [np.cos(np.radians(10)), np.sin(np.radians(10)), 0], atol=1e-6
    )
