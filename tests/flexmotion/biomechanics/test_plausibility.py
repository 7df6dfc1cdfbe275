"""Limits of angles, speeds and torques of human joints."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from flexmotion.biomechanics.plausibility import REACH, plausible, within_turn
from flexmotion.human.angles import rotation_about, three_angle_rotation, three_angles
from flexmotion.human.joint_limits import joint_limits
from flexmotion.human.motion import Motion
from flexmotion.human.skeleton import DOF_COUNT, JOINTS
from flexmotion.importers.foot import dorsiflexion

SHOULDER = ("shoulder_flexion", "shoulder_adduction", "shoulder_rotation")
COLUMNS = [JOINTS.index(f"{name}_l") for name in SHOULDER]


def circling_arm(make_standing: Callable[..., Motion], turns: int) -> Motion:
    """The left upper arm points sideways and circles about that axis."""
    angle = np.linspace(0, 2 * np.pi * turns, 40 * turns)
    tilt = rotation_about("x", np.pi / 2) @ rotation_about("y", np.full(len(angle), 0.2))
    rotation = rotation_about("y", angle) @ tilt @ rotation_about("z", -angle)
    motion = make_standing(len(angle))
    motion.joints[:, COLUMNS] = three_angles(rotation, SHOULDER, "l")
    return replace(motion, torques=np.zeros((len(angle), DOF_COUNT)))


def test_angles_of_a_circling_arm_stay_within_a_turn(make_standing: Callable[..., Motion]) -> None:
    """Regression: shoulder angles reached 29.7 rad in clips of waving, by a turn for every circle."""
    motion = circling_arm(make_standing, 4)
    assert np.abs(motion.joints).max() > 2 * np.pi
    joints = within_turn(motion.joints)
    lower, upper = joint_limits().T
    assert (joints >= (lower + upper) / 2 - np.pi).all() and (joints <= (lower + upper) / 2 + np.pi).all()
    before = three_angle_rotation(motion.joints[:, COLUMNS], SHOULDER, "l")
    after = three_angle_rotation(joints[:, COLUMNS], SHOULDER, "l")
    assert (before.inv() * after).magnitude() == pytest.approx(0.0, abs=1e-9)
    # Removed turns do not count as speed.
    assert plausible(replace(motion, joints=joints)).all()


def test_an_outlier_of_a_foot_does_not_shift_later_angles_by_a_turn() -> None:
    """Regression: the direction of the toes made a full turn in a dance, and the ankle stayed at 13.5 rad."""
    frames = 40
    pitch = np.full(frames, -0.3)
    pitch[15:21] -= np.linspace(0, 2 * np.pi, 6)
    line = np.stack([np.cos(pitch), np.zeros(frames), np.sin(pitch)], axis=1)
    angle = dorsiflexion(np.tile(np.eye(3), (frames, 1, 1)), line, -0.3, 0.0)
    assert angle[[0, 14, 21, 39]] == pytest.approx(0.0, abs=1e-6)
    assert np.abs(angle).max() < np.pi + 0.5


def test_a_foot_that_points_out_of_the_plane_keeps_its_ankle() -> None:
    frames = 30
    line = np.tile([np.cos(0.3), 0.0, -np.sin(0.3)], (frames, 1))
    noise = 0.01 * np.random.default_rng(0).standard_normal((4, 2))
    line[10:14] = np.stack([noise[:, 0], np.ones(4), noise[:, 1]], axis=1)
    angle = dorsiflexion(np.tile(np.eye(3), (frames, 1, 1)), line, -0.3, 0.0)
    # The remaining change keeps the sole's pitch in the world.
    assert np.abs(angle).max() < 0.3


@pytest.mark.parametrize("what", ["angle", "hinge speed", "ball speed", "torque"])
def test_implausible_frames_are_detected(make_standing: Callable[..., Motion], what: str) -> None:
    motion = make_standing(9)
    torques = np.zeros((9, DOF_COUNT))
    expected = np.ones(9, bool)
    if what == "angle":
        motion.joints[4, JOINTS.index("knee_flexion_r")] = np.radians(-25)
        expected[4] = False
    elif what == "torque":
        torques[4, -len(JOINTS) + JOINTS.index("hip_adduction_l")] = -(REACH.torque + 0.1) * motion.body.mass
        expected[4] = False
    else:
        joint = "elbow_flexion_l" if what == "hinge speed" else "hip_flexion_l"
        motion.joints[5:, JOINTS.index(joint)] = 1.1 * REACH.speed / motion.fps
        expected[4:6] = False
    assert plausible(replace(motion, torques=torques)).tolist() == expected.tolist()


def test_forces_on_the_root_are_residuals_not_torques(make_standing: Callable[..., Motion]) -> None:
    torques = np.zeros((3, DOF_COUNT))
    torques[:, :6] = 1e4
    assert plausible(replace(make_standing(3), torques=torques)).all()


def test_a_single_frame(make_standing: Callable[..., Motion]) -> None:
    assert plausible(replace(make_standing(1), torques=np.zeros((1, DOF_COUNT)))).tolist() == [True]
