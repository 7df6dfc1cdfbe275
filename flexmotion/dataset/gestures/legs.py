"""`lowered_pelvis`: a human that stands goes down over its feet, in balance."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from flexmotion.human.angles import three_angles
from flexmotion.human.kinematics import HumanKinematics, forward
from flexmotion.human.motion import Motion
from flexmotion.human.skeleton import JOINTS, SIDES
from flexmotion.human.vectors import unit
from flexmotion.spatial.quaternions import continuous_quaternions

Float = NDArray[np.float64]

HIP = ("hip_flexion", "hip_adduction", "hip_rotation")

ROUNDS = 4
"""Repetitions of the shift that puts the centre of mass back; the error is then below 1 mm."""

STRAIGHT = np.radians(1.0)
"""Least flexion of a knee that goes down [rad]."""


def lowered_pelvis(motion: Motion, down: Float, tilt: Float, com: Float) -> Motion:
    """A standing motion with its pelvis lowered; its ankles stay.

    Each leg stays in a plane through its hip and ankle, which is turned from that of the foot only as far as the hip
    leaves it; the foot rolls by that angle (up to about three degrees in a deep squat with turned-out feet).

    Args:
        motion: stands; arms and trunk as they are to be while the pelvis is lowered.
        down: lowering of the pelvis, (T,) [m].
        tilt: of the pelvis forward, (T,) [rad].
        com: where the centre of mass is to be while the pelvis is lowered, (T, 3) [m]; its height is not used.
    """
    moving = down > 0.0
    if not moving.any():
        return motion
    base = forward(motion)
    # The hips lie on the axis of the tilt and stay.
    tilted = Rotation.from_rotvec(tilt[:, None] * [0.0, 1.0, 0.0])
    turned = Rotation.from_matrix(base.pelvis_rotation) * tilted
    quaternions = continuous_quaternions(turned.as_quat(scalar_first=True))
    shift = np.zeros((len(motion), 3))
    shift[:, 2] = -down
    leaning = replace(motion, root_quaternion=quaternions)
    for _ in range(ROUNDS):
        result = _with_root(leaning, base, shift)
        away = forward(result).com - com
        shift[:, :2] -= np.where(moving[:, None], away[:, :2], 0.0)
    return _with_root(leaning, base, shift)


def _with_root(motion: Motion, base: HumanKinematics, shift: Float) -> Motion:
    """The motion with its root moved by `shift`, (T, 3) [m], on legs that keep ankles and soles where they are."""
    size, joints = motion.body.segments, motion.joints.copy()
    moved = np.linalg.norm(shift, axis=1) > 0.0
    pelvis = Rotation.from_quat(motion.root_quaternion, scalar_first=True).as_matrix()
    for side, letter in enumerate(SIDES):
        hip, ankle = base.hip[:, side] + shift, base.ankle[:, side]
        line = ankle - hip
        distance = np.clip(np.linalg.norm(line, axis=1), 0.3 * size.leg, size.leg * np.cos(STRAIGHT / 2))
        along = unit(line)
        # Tibia and foot share their lateral axis, less the foot's fixed turn out of the knee's plane.
        turn = Rotation.from_euler("z", -size.toe_out if letter == "l" else size.toe_out).as_matrix()
        foot = base.foot_rotation[:, side] @ turn
        lateral = unit(foot[:, :, 1] - np.sum(foot[:, :, 1] * along, axis=1, keepdims=True) * along)
        knee = np.arccos(
            np.clip((distance**2 - size.thigh**2 - size.shank**2) / (2 * size.thigh * size.shank), -1.0, 1.0)
        )
        behind = np.arctan2(size.shank * np.sin(knee), size.thigh + size.shank * np.cos(knee))
        # The thigh lies in front of the line from hip to ankle, the shank behind it.
        front = np.cross(lateral, -along)
        thigh = np.cos(behind)[:, None] * along + np.sin(behind)[:, None] * front
        shank = np.cos(knee - behind)[:, None] * along - np.sin(knee - behind)[:, None] * front
        femur = np.stack([np.cross(lateral, -thigh), lateral, -thigh], axis=2)
        tibia_x = np.cross(lateral, -shank)
        # The foot's own length, level as in the base, in the axes of the shank.
        length = foot[:, :, 0] - np.sum(foot[:, :, 0] * lateral, axis=1, keepdims=True) * lateral
        ankle_angle = np.arctan2(-np.sum(length * shank, axis=1), np.sum(length * tibia_x, axis=1))
        hips = three_angles(np.einsum("tji,tjk->tik", pelvis, femur), HIP, letter)
        found = [*zip(HIP, hips.T, strict=True), ("knee_flexion", knee), ("ankle_dorsiflexion", ankle_angle)]
        for name, angles in found:
            joints[moved, JOINTS.index(f"{name}_{letter}")] = angles[moved]
    return replace(motion, root_position=motion.root_position + shift, joints=joints)
