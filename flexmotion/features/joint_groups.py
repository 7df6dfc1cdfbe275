"""Joint rotations as features, without the jumps of three hinge angles in a row.

Joints of three hinges (lumbar, neck, hips, shoulders) and the pelvis are represented by the first two columns of their
rotation matrix (Zhou et al., On the Continuity of Rotation Representations in Neural Networks, CVPR 2019), single
hinges by their angle.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from flexmotion.human.human_model import AXES, MIRRORED
from flexmotion.human.skeleton import JOINTS, SIDES
from flexmotion.human.vectors import cross

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
    first, second = columns[..., :3], columns[..., 3:]
    found = np.empty((*first.shape, 3))
    found[..., 0] = x = first / np.maximum(_length(first), 1e-8)
    y = second - np.einsum("...i,...i->...", x, second)[..., None] * x
    found[..., 1] = y = y / np.maximum(_length(y), 1e-8)
    found[..., 2] = cross(x, y)
    return found


def _length(vectors: Float) -> Float:
    found: Float = np.sqrt(np.einsum("...i,...i->...", vectors, vectors))[..., None]
    return found


def ball_matrices(joints: Float) -> Float:
    """Rotations of the joints of three hinges, (..., 26) [rad] -> (..., 6, 3, 3)."""
    angles = joints[..., BALL_COLUMNS] * BALL_SIGNS
    (a, b, c), (sa, sb, sc) = np.moveaxis(np.cos(angles), -1, 0), np.moveaxis(np.sin(angles), -1, 0)
    # Ry(a) Rx(b) Rz(c)
    rows = [
        [a * c + sa * sb * sc, -a * sc + sa * sb * c, sa * b],
        [b * sc, b * c, -sb],
        [-sa * c + a * sb * sc, sa * sc + a * sb * c, a * b],
    ]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def ball_angles(matrices: Float, start: Float) -> Float:
    """Hinge angles of a sequence of ball rotations, (T, 6, 3, 3) -> (T, 6, 3) [rad].

    Every rotation has two solutions within a turn; the result is the one nearer to the frame before, with whole turns
    counted.

    Args:
        matrices: rotations.
        start: angles of the frame before the first, (6, 3) [rad].
    """
    first = np.arctan2(matrices[..., 0, 2], matrices[..., 2, 2])
    cosine, sine = np.cos(first), np.sin(first)
    # The last angle given the first: near gimbal lock each alone is noise, their combination is not.
    row = cosine[..., None] * matrices[..., 0, :] - sine[..., None] * matrices[..., 2, :]
    second = np.arctan2(-matrices[..., 1, 2], sine * matrices[..., 0, 2] + cosine * matrices[..., 2, 2])
    third = np.arctan2(-row[..., 1], row[..., 0])
    near = np.stack([first, second, third], axis=-1)
    other = np.stack([first + np.pi, np.pi - second, third + np.pi], axis=-1)
    candidates = np.stack([near, other], axis=1)  # (T, 2, 6, 3)
    turn = 2 * np.pi
    # Which solution is nearer depends on which one was taken before, not on its whole turns: both cases, all frames.
    before = np.concatenate([np.broadcast_to(start * BALL_SIGNS, (1, 2, *start.shape)), candidates[:-1]])
    away = candidates[:, None] - before[:, :, None]  # (T, 2 before, 2 now, 6, 3)
    away -= turn * np.round(away / turn)
    nearer = np.sum(away**2, axis=-1).argmin(axis=2)  # (T, 2 before, 6)
    chosen = np.empty((len(near), len(BALLS)), np.intp)
    balls = np.arange(len(BALLS))
    last = np.zeros(len(BALLS), np.intp)
    for frame, following in enumerate(nearer):
        last = chosen[frame] = following[last, balls]
    angles = np.where(chosen[..., None] == 0, near, other)
    turns = np.round(np.diff(angles, axis=0, prepend=(start * BALL_SIGNS)[None]) / turn)
    return (angles - turn * np.cumsum(turns, axis=0)) * BALL_SIGNS
