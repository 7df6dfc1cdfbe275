"""Rotations of many rows: Euler angles, quaternions w x y z, matrices, rotation vectors.

`scipy.spatial.transform.Rotation` gives the same within rounding; each of its calls takes .2 ms, of which a plan made
eight.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Float = NDArray[np.float64]

_SMALL = 1e-8
"""Sine of half an angle below which the rotation vector is twice the quaternion's vector part."""


def zyx_quaternion(yaw: Float, pitch: Float, roll: Float) -> Float:
    """Quaternions of rotations about z, then the new y, then the new x, (T,) [rad] -> (T, 4).

    They are continuous in the angles: a turn by 2 pi changes their sign.
    """
    cz, sz = np.cos(0.5 * yaw), np.sin(0.5 * yaw)
    cy, sy = np.cos(0.5 * pitch), np.sin(0.5 * pitch)
    cx, sx = np.cos(0.5 * roll), np.sin(0.5 * roll)
    return np.column_stack(
        [
            cz * cy * cx + sz * sy * sx,
            cz * cy * sx - sz * sy * cx,
            cz * sy * cx + sz * cy * sx,
            sz * cy * cx - cz * sy * sx,
        ]
    )


def zyx_yaw_pitch(rotation: Float) -> tuple[Float, Float]:
    """Yaw and pitch of the same angles of rotation matrices, (T, 3, 3) -> (T,) and (T,) [rad]."""
    return np.arctan2(rotation[:, 1, 0], rotation[:, 0, 0]), -np.arcsin(np.clip(rotation[:, 2, 0], -1.0, 1.0))


def matrices(quaternion: Float) -> Float:
    """Rotation matrices of unit quaternions, (..., 4) -> (..., 3, 3)."""
    w, x, y, z = (quaternion[..., part] for part in range(4))
    out = np.empty((*w.shape, 3, 3))
    out[..., 0, 0], out[..., 0, 1], out[..., 0, 2] = 1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)
    out[..., 1, 0], out[..., 1, 1], out[..., 1, 2] = 2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)
    out[..., 2, 0], out[..., 2, 1], out[..., 2, 2] = 2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)
    return out


def matrix_quaternions(rotation: Float) -> Float:
    """Unit quaternions of rotation matrices, (..., 3, 3) -> (..., 4); the greatest component is not negative."""
    a, b, c, d, e, f, g, h, i = (rotation[..., row, column] for row in range(3) for column in range(3))
    # 4 q qᵀ: any row is a multiple of the quaternion, that of the greatest component the one that rounding harms least.
    rows = np.empty((*rotation.shape[:-2], 4, 4))
    rows[..., 0, 0], rows[..., 1, 1] = 1.0 + a + e + i, 1.0 + a - e - i
    rows[..., 2, 2], rows[..., 3, 3] = 1.0 - a + e - i, 1.0 - a - e + i
    rows[..., 0, 1] = rows[..., 1, 0] = h - f
    rows[..., 0, 2] = rows[..., 2, 0] = c - g
    rows[..., 0, 3] = rows[..., 3, 0] = d - b
    rows[..., 1, 2] = rows[..., 2, 1] = b + d
    rows[..., 1, 3] = rows[..., 3, 1] = c + g
    rows[..., 2, 3] = rows[..., 3, 2] = f + h
    flat = rows.reshape(-1, 4, 4)
    best = np.einsum("nii->ni", flat).argmax(axis=1)
    found = flat[np.arange(len(flat)), best]
    found /= np.sqrt(np.einsum("ni,ni->n", found, found))[:, None]
    return found.reshape(rows.shape[:-1])


def rotation_vectors(quaternion: Float) -> Float:
    """Rotation vectors of unit quaternions, no longer than half a turn, (..., 4) -> (..., 3) [rad]."""
    vector, w = quaternion[..., 1:], quaternion[..., :1]
    sine = np.sqrt(np.einsum("...i,...i->...", vector, vector))[..., None]
    # q and -q are one rotation: the shorter way.
    angle = 2.0 * np.arctan2(sine, np.abs(w))
    scale = np.where(sine > _SMALL, angle / np.maximum(sine, _SMALL), 2.0)
    return vector * np.where(w < 0.0, -scale, scale)


def vector_quaternions(vectors: Float) -> Float:
    """Unit quaternions of rotation vectors, (..., 3) [rad] -> (..., 4)."""
    half = 0.5 * np.sqrt(np.einsum("...i,...i->...", vectors, vectors))[..., None]
    return np.concatenate([np.cos(half), 0.5 * np.sinc(half / np.pi) * vectors], axis=-1)


def yaw_matrices(yaw: Float) -> Float:
    """Rotations about the vertical, (T,) [rad] -> (T, 3, 3)."""
    out = np.zeros((len(yaw), 3, 3))
    out[:, 0, 0] = out[:, 1, 1] = np.cos(yaw)
    out[:, 1, 0] = np.sin(yaw)
    out[:, 0, 1] = -out[:, 1, 0]
    out[:, 2, 2] = 1.0
    return out


def add_cross(matrices: Float, vector: Float) -> None:
    """Add the matrices of the cross product with vectors (..., 3) to matrices (..., 3, 3), in place."""
    x, y, z = (vector[..., part] for part in range(3))
    matrices[..., 0, 1] -= z
    matrices[..., 1, 0] += z
    matrices[..., 0, 2] += y
    matrices[..., 2, 0] -= y
    matrices[..., 1, 2] -= x
    matrices[..., 2, 1] += x


def turns(quaternion: Float) -> Float:
    """Rotation vectors from each row to the next in the body's frame, (T + 1, 4) -> (T, 3) [rad]."""
    (a, *v), (b, *u) = quaternion[:-1].T, quaternion[1:].T
    w = a * b + v[0] * u[0] + v[1] * u[1] + v[2] * u[2]
    vector = np.column_stack(
        [
            a * u[0] - b * v[0] - v[1] * u[2] + v[2] * u[1],
            a * u[1] - b * v[1] - v[2] * u[0] + v[0] * u[2],
            a * u[2] - b * v[2] - v[0] * u[1] + v[1] * u[0],
        ]
    )
    sine = np.sqrt(np.sum(vector**2, axis=1))
    # q and -q are one rotation: the shorter way.
    angle = 2.0 * np.arctan2(sine, np.abs(w))
    scale = np.where(sine > _SMALL, angle / np.maximum(sine, _SMALL), 2.0)
    return vector * (scale * np.where(w < 0.0, -1.0, 1.0))[:, None]
