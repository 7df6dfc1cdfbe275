"""Joint rotations as features, without the jumps of three hinge angles in a row.

Joints of three hinges (lumbar, neck, hips, shoulders) and the pelvis are represented by the first two columns of their
rotation matrix (Zhou et al., On the Continuity of Rotation Representations in Neural Networks, CVPR 2019), single
hinges by their angle.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from flexmotion.features import feature_loops
from flexmotion.features.feature_loops import orthonormal
from flexmotion.human.human_model import AXES, MIRRORED
from flexmotion.human.skeleton import JOINTS, SIDES

Float = NDArray[np.float64]

BALLS: tuple[tuple[str, ...], ...] = (
    ("lumbar_extension", "lumbar_bending", "lumbar_rotation"),
    ("neck_extension", "neck_bending", "neck_rotation"),
    *(
        tuple(f"{joint}_{coordinate}_{side}" for coordinate in ("flexion", "adduction", "rotation"))
        for joint in ("hip", "shoulder")
        for side in SIDES
    ),
)
"""Joints of three hinges, about y, x, z in that order; see `BALL_SIGNS` for the signs."""

ALL_BALLS = tuple(range(len(BALLS)))

HINGES: tuple[str, ...] = tuple(name for name in JOINTS if not any(name in ball for ball in BALLS))
"""Joints of one hinge, in the order of `JOINTS`."""

BALL_COLUMNS = np.array([[JOINTS.index(name) for name in ball] for ball in BALLS])
HINGE_COLUMNS = np.array([JOINTS.index(name) for name in HINGES])

PELVIS_SIZE = 6
ROTATION_SIZE = PELVIS_SIZE + 6 * len(BALLS) + len(HINGES)
"""Size of the block `rotations`: pelvis (heading removed), balls, hinges."""


def sign(joint: str) -> float:
    """Sign of a coordinate against the positive rotation about its axis."""
    base = joint[:-2] if joint.endswith(("_l", "_r")) else joint
    value = sum(AXES[base])
    return -value if joint.endswith("_l") and base in MIRRORED else value


BALL_SIGNS = np.array([[sign(name) for name in ball] for ball in BALLS])


def six(matrix: Float) -> Float:
    """First two columns of rotation matrices, one after the other, (..., 3, 3) -> (..., 6)."""
    return np.concatenate([matrix[..., 0], matrix[..., 1]], axis=-1)


def matrix(columns: Float) -> Float:
    """Rotation matrices from two columns by Gram-Schmidt orthonormalisation, (..., 6) -> (..., 3, 3)."""
    return orthonormal(_rows(columns)).reshape(*columns.shape[:-1], 3, 3)


def ball_matrices(joints: Float, balls: Sequence[int] = ALL_BALLS) -> Float:
    """Rotations of the joints of three hinges, (..., 26) [rad] -> (..., 6, 3, 3).

    Args:
        joints: angles of all joints.
        balls: numbers of the K wanted ones among `BALLS`; the rotations are then (..., K, 3, 3).
    """
    own = list(balls)
    found = feature_loops.ball_matrices(_rows(joints), BALL_COLUMNS[own], BALL_SIGNS[own])
    return found.reshape(*joints.shape[:-1], len(own), 3, 3)


def ball_angles(matrices: Float, start: Float, balls: Sequence[int] = ALL_BALLS) -> Float:
    """Hinge angles of a sequence of ball rotations, (T, 6, 3, 3) -> (T, 6, 3) [rad].

    Every rotation has two solutions within a turn; the result is the one nearer to the frame before, with whole turns
    counted.

    Args:
        matrices: rotations.
        start: angles of the frame before the first, (6, 3) [rad].
        balls: numbers of the K joints among `BALLS` that the others' arrays are of, (T, K, 3, 3) and (K, 3).
    """
    begin = np.ascontiguousarray(start, np.float64)
    return feature_loops.ball_angles(np.ascontiguousarray(matrices, np.float64), begin, BALL_SIGNS[list(balls)])


def _rows(values: Float) -> Float:
    """Values with all axes but the last as one, in memory one after the other."""
    return np.ascontiguousarray(values, np.float64).reshape(-1, values.shape[-1])
