"""The frame that features are in: on the floor below the pelvis, x where it faces, z up."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Float = NDArray[np.float64]


def yaw_matrix(yaw: Float) -> Float:
    """Rotations about z, (...,) [rad] -> (..., 3, 3)."""
    cosine, sine = np.cos(yaw), np.sin(yaw)
    zero, one = np.zeros_like(cosine), np.ones_like(cosine)
    rows = [[cosine, -sine, zero], [sine, cosine, zero], [zero, zero, one]]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def turned(vector: Float, yaw: Float) -> Float:
    """Vectors turned about z, (T, ..., 3) by (T,) [rad]."""
    cosine, sine = np.cos(yaw), np.sin(yaw)
    shape = (len(vector), *[1] * (vector.ndim - 2))
    cosine, sine = cosine.reshape(shape), sine.reshape(shape)
    x, y, z = vector[..., 0], vector[..., 1], vector[..., 2]
    return np.stack([cosine * x - sine * y, sine * x + cosine * y, z], axis=-1)
