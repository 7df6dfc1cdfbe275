"""Joint angles from rotations, without jumps over time."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from flexmotion.human.human_model import AXES, MIRRORED

Float = NDArray[np.float64]

JOINT_AXES = "YXZ"
"""Axes of every joint with three coordinates, intrinsic (see `skeleton`)."""

Ball = tuple[tuple[str, str, str], str]
"""Names of a joint's three coordinates, and its side: "l", "r", or "" for a joint of the trunk."""

REACH = np.radians(100)
"""Beyond this second angle (adduction, bending) the mirror solution of the angles is preferred [rad]."""


def three_angles(rotation: Float, joints: tuple[str, str, str], side: str = "") -> Float:
    """Coordinates of a joint with three hinges, (T, 3, 3) distal in proximal axes -> (T, 3) [rad].

    Every rotation has two solutions within a turn; the result is the sequence that moves least over the whole clip.
    """
    return angles_of_joints(rotation[:, None], [(joints, side)])


def angles_of_joints(rotation: Float, joints: Sequence[Ball]) -> Float:
    """`three_angles` of J joints in one go, which takes little longer than one of them in a short clip.

    Args:
        rotation: distal in proximal axes, (T, J, 3, 3).
        joints: names and side of each.

    Returns:
        Coordinates, joint after joint, (T, 3 J) [rad].
    """
    if not len(rotation):
        return np.empty((0, 3 * len(joints)))
    first = _euler_yxz(rotation)
    other = np.stack([first[..., 0] + np.pi, np.pi - first[..., 1], first[..., 2] + np.pi], axis=-1)
    angles = np.unwrap(_least_motion(first, other).reshape(len(rotation), -1), axis=0)
    angles -= 2 * np.pi * np.round(np.median(angles, axis=0) / (2 * np.pi))
    return angles * [_sign(name, side) for names, side in joints for name in names]


def three_angle_rotation(angles: Float, joints: tuple[str, str, str], side: str = "") -> Rotation:
    """Rotation of the distal in the proximal axes, the inverse of `three_angles`, (T, 3) [rad] -> T rotations."""
    return Rotation.from_euler(JOINT_AXES, angles * [_sign(joint, side) for joint in joints])


def _sign(joint: str, side: str) -> float:
    """Sign of a coordinate against the positive rotation about x, y or z."""
    sign = sum(AXES[joint])
    return -sign if side == "l" and joint in MIRRORED else sign


def _euler_yxz(rotation: Float) -> Float:
    """Angles (a, b, c) with R = Ry(a) Rx(b) Rz(c) and |b| <= π/2, (..., 3, 3) -> (..., 3)."""
    first = np.arctan2(rotation[..., 0, 2], rotation[..., 2, 2])
    # The last angle given the first: near gimbal lock each alone is noise, their combination is not.
    cosine, sine = np.cos(first), np.sin(first)
    row = cosine[..., None] * rotation[..., 0, :] - sine[..., None] * rotation[..., 2, :]
    second = np.arctan2(-rotation[..., 1, 2], sine * rotation[..., 0, 2] + cosine * rotation[..., 2, 2])
    return np.stack([first, second, np.arctan2(-row[..., 1], row[..., 0])], axis=-1)


def _least_motion(first: Float, other: Float) -> Float:
    """By joint the sequence of two candidates per frame that moves least (sum of squares), (T, J, 3) each (Viterbi)."""
    candidates = np.stack([first, other], axis=2)
    # Cost of going from candidate i of a frame to j of the next, (T - 1, J, 2, 2).
    step = candidates[1:, :, None, :, :] - candidates[:-1, :, :, None, :]
    step = (step + np.pi) % (2 * np.pi) - np.pi
    steps = np.sum(step**2, axis=-1)
    wrapped = np.abs((candidates[..., 1] + np.pi) % (2 * np.pi) - np.pi)
    # A small cost of contorted angles decides between sequences that move equally.
    strange = 1e-3 * np.maximum(wrapped - REACH, 0.0)
    choice = [_cheapest(steps[:, joint].tolist(), strange[:, joint].tolist()) for joint in range(first.shape[1])]
    return np.where(np.transpose(choice)[..., None] == 1, other, first)


def _cheapest(steps: list[list[list[float]]], strange: list[list[float]]) -> list[int]:
    """Candidate of every frame of one joint: 0 or 1. Plain numbers take a tenth of the time of arrays this small.

    Args:
        steps: cost of going from candidate i of a frame to j of the next, (T - 1, 2, 2).
        strange: cost of each candidate by itself, (T, 2).
    """
    cost, came_from = strange[0], []
    for ((stay, leave), (enter, remain)), (here, there) in zip(steps, strange[1:], strict=True):
        to_first, back, to_other, on = cost[0] + stay, cost[1] + enter, cost[0] + leave, cost[1] + remain
        came_from.append((int(back < to_first), int(on < to_other)))
        cost = [min(to_first, back) + here, min(to_other, on) + there]
    choice = [int(cost[1] < cost[0])]
    for came in reversed(came_from):
        choice.append(came[choice[-1]])
    return choice[::-1]


def rotation_about(axis: str, angle: Float | float) -> Float:
    """Rotation matrices about x, y or z, (...,) [rad] -> (..., 3, 3)."""
    about = "xyz".index(axis)
    first, second = (about + 1) % 3, (about + 2) % 3
    cosine, sine = np.cos(angle), np.sin(angle)
    matrices = np.zeros((*np.shape(angle), 3, 3))
    matrices[..., about, about] = 1.0
    matrices[..., first, first] = matrices[..., second, second] = cosine
    matrices[..., second, first], matrices[..., first, second] = sine, -sine
    return matrices
