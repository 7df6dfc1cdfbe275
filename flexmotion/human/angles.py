"""Joint angles from rotations, without jumps over time."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from flexmotion.human.human_model import AXES, MIRRORED

Float = NDArray[np.float64]

JOINT_AXES = "YXZ"
"""Axes of every joint with three coordinates, intrinsic (see `skeleton`)."""

REACH = np.radians(100)
"""Beyond this second angle (adduction, bending) the mirror solution of the angles is preferred [rad]."""


def three_angles(rotation: Float, joints: tuple[str, str, str], side: str = "") -> Float:
    """Coordinates of a joint with three hinges, (T, 3, 3) distal in proximal axes -> (T, 3) [rad].

    Every rotation has two solutions within a turn; the result is the sequence that moves least over the whole clip.
    """
    if not len(rotation):
        return np.empty((0, 3))
    first = _euler_yxz(rotation)
    other = np.stack([first[:, 0] + np.pi, np.pi - first[:, 1], first[:, 2] + np.pi], axis=1)
    angles = np.unwrap(_least_motion(first, other), axis=0)
    angles -= 2 * np.pi * np.round(np.median(angles, axis=0) / (2 * np.pi))
    return angles * [_sign(joint, side) for joint in joints]


def three_angle_rotation(angles: Float, joints: tuple[str, str, str], side: str = "") -> Rotation:
    """Rotation of the distal in the proximal axes, the inverse of `three_angles`, (T, 3) [rad] -> T rotations."""
    return Rotation.from_euler(JOINT_AXES, angles * [_sign(joint, side) for joint in joints])


def _sign(joint: str, side: str) -> float:
    """Sign of a coordinate against the positive rotation about x, y or z."""
    sign = sum(AXES[joint])
    return -sign if side == "l" and joint in MIRRORED else sign


def _euler_yxz(rotation: Float) -> Float:
    """Angles (a, b, c) with R = Ry(a) Rx(b) Rz(c) and |b| <= π/2, (T, 3, 3) -> (T, 3)."""
    first = np.arctan2(rotation[:, 0, 2], rotation[:, 2, 2])
    # The last angle given the first: near gimbal lock each alone is noise, their combination is not.
    cosine, sine = np.cos(first), np.sin(first)
    row = cosine[:, None] * rotation[:, 0] - sine[:, None] * rotation[:, 2]
    second = np.arctan2(-rotation[:, 1, 2], sine * rotation[:, 0, 2] + cosine * rotation[:, 2, 2])
    return np.stack([first, second, np.arctan2(-row[:, 1], row[:, 0])], axis=1)


def _least_motion(first: Float, other: Float) -> Float:
    """Sequence with the least sum of squared steps from two candidates per frame, (T, n) each (Viterbi)."""
    candidates = np.stack([first, other], axis=1)
    # Cost of going from candidate i of a frame to j of the next, (T - 1, 2, 2).
    step = candidates[1:, None, :, :] - candidates[:-1, :, None, :]
    step = (step + np.pi) % (2 * np.pi) - np.pi
    steps = np.sum(step**2, axis=-1)
    wrapped = np.abs((candidates[..., 1] + np.pi) % (2 * np.pi) - np.pi)
    # A small cost of contorted angles decides between sequences that move equally.
    strange = 1e-3 * np.maximum(wrapped - REACH, 0.0)
    cost = strange[0]
    came_from = np.empty((len(first), 2), dtype=np.intp)
    for frame in range(1, len(first)):
        total = cost[:, None] + steps[frame - 1]
        came_from[frame] = total.argmin(axis=0)
        cost = total.min(axis=0) + strange[frame]
    choice = np.empty(len(first), dtype=np.intp)
    choice[-1] = cost.argmin()
    for frame in range(len(first) - 1, 0, -1):
        choice[frame - 1] = came_from[frame, choice[frame]]
    return candidates[np.arange(len(first)), choice]


def rotation_about(axis: str, angle: Float | float) -> Float:
    """Rotation matrices about x, y or z, (...,) [rad] -> (..., 3, 3)."""
    vector = np.asarray(angle)[..., None] * np.eye(3)["xyz".index(axis)]
    matrices: Float = Rotation.from_rotvec(vector).as_matrix()
    return matrices
