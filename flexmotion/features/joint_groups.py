"""Joint rotations as features, without the jumps of three hinge angles in a row.

Joints of three hinges (lumbar, neck, hips, shoulders) and the pelvis are represented by the first two columns of their
rotation matrix (Zhou et al., On the Continuity of Rotation Representations in Neural Networks, CVPR 2019), single
hinges by their angle.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from flexmotion.human.human_model import AXES, MIRRORED
from flexmotion.human.skeleton import JOINTS, SIDES
from flexmotion.human.vectors import cross

Float = NDArray[np.float64]
Flags = NDArray[np.bool_]

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


def ball_matrices(joints: Float, balls: Sequence[int] = ALL_BALLS) -> Float:
    """Rotations of the joints of three hinges, (..., 26) [rad] -> (..., 6, 3, 3).

    Args:
        joints: angles of all joints.
        balls: numbers of the K wanted ones among `BALLS`; the rotations are then (..., K, 3, 3).
    """
    own = list(balls)
    angles = joints[..., BALL_COLUMNS[own]] * BALL_SIGNS[own]
    cosine, sine = np.cos(angles), np.sin(angles)
    a, b, c, sa, sb, sc = *(cosine[..., axis] for axis in range(3)), *(sine[..., axis] for axis in range(3))
    found = np.empty((*a.shape, 3, 3))  # Ry(a) Rx(b) Rz(c)
    tilted, turned = sa * sb, a * sb
    found[..., 0, 0], found[..., 0, 1], found[..., 0, 2] = a * c + tilted * sc, tilted * c - a * sc, sa * b
    found[..., 1, 0], found[..., 1, 1], found[..., 1, 2] = b * sc, b * c, -sb
    found[..., 2, 0], found[..., 2, 1], found[..., 2, 2] = turned * sc - sa * c, sa * sc + turned * c, a * b
    return found


def ball_angles(matrices: Float, start: Float, balls: Sequence[int] = ALL_BALLS) -> Float:
    """Hinge angles of a sequence of ball rotations, (T, 6, 3, 3) -> (T, 6, 3) [rad].

    Every rotation has two solutions within a turn; the result is the one nearer to the frame before, with whole turns
    counted.

    Args:
        matrices: rotations.
        start: angles of the frame before the first, (6, 3) [rad].
        balls: numbers of the K joints among `BALLS` that the others' arrays are of, (T, K, 3, 3) and (K, 3).
    """
    signs, turn = BALL_SIGNS[list(balls)], 2 * np.pi
    begin = start * signs
    first = np.arctan2(matrices[..., 0, 2], matrices[..., 2, 2])
    cosine, sine = np.cos(first), np.sin(first)
    # The last angle given the first: near gimbal lock each alone is noise, their combination is not.
    row = cosine[..., None] * matrices[..., 0, :] - sine[..., None] * matrices[..., 2, :]
    candidates = np.empty((len(first), 2, *begin.shape))  # the first one with a second angle below a right angle
    near, other = candidates[:, 0], candidates[:, 1]
    near[..., 0] = first
    near[..., 1] = np.arctan2(-matrices[..., 1, 2], sine * matrices[..., 0, 2] + cosine * matrices[..., 2, 2])
    near[..., 2] = np.arctan2(-row[..., 1], row[..., 0])
    np.add(near, np.pi, out=other)
    np.subtract(np.pi, near[..., 1], out=other[..., 1])
    # Which solution is nearer depends on which one was taken before, not on its whole turns: both cases, all frames.
    before = np.empty_like(candidates)
    before[:1], before[1:] = begin, candidates[:-1]
    away = candidates[:, None] - before[:, :, None]  # (T, 2 before, 2 now, K, 3)
    away -= turn * np.round(away / turn)
    distance = np.einsum("...i,...i->...", away, away)
    angles = np.where(_followed(distance[:, :, 1] < distance[:, :, 0])[..., None], other, near)
    before = np.concatenate([begin[None], angles[:-1]])
    return (angles - turn * np.cumsum(np.round((angles - before) / turn), axis=0)) * signs


def _followed(other: Flags) -> Flags:
    """Which of two solutions is taken in each frame, True for the other one, (T, K).

    Args:
        other: whether the other one is nearer, by the solution that was taken before, (T, 2, K); both alike at first.
    """
    after_near, after_other = other[:, 0], other[:, 1]
    if not after_near.any():
        return after_near
    # A frame tells its solution by itself, or keeps or changes that of the frame before: the last one that told counts,
    # and the changes since then.
    tells = after_near == after_other
    last = np.maximum.accumulate(np.where(tells, np.arange(len(other))[:, None], 0), axis=0)
    changes = np.logical_xor.accumulate(after_near & ~tells, axis=0)
    told, before = np.take_along_axis(after_near, last, axis=0), np.take_along_axis(changes, last, axis=0)
    return np.asarray(told ^ changes ^ before)
