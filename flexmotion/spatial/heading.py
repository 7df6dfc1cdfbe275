"""Heading: the rotation about the world's z axis.

The angle is the twist about z of the swing-twist decomposition. Unlike the azimuth of the x axis it stays defined when
a body bends forward by 90° and more; it is undefined only upside down.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

Float = NDArray[np.float64]


def heading(quaternion: Float) -> Float:
    """Heading of unit quaternions w x y z, (..., 4) -> (...) [rad], in [-π, π]; NaN stays."""
    w, z = quaternion[..., 0], quaternion[..., 3]
    # q and -q are one rotation.
    angle: Float = 2.0 * np.arctan2(np.where(w < 0, -z, z), np.abs(w))
    return angle


def matrix_heading(rotation: Float) -> Float:
    """Heading of rotation matrices, (..., 3, 3) -> (...) [rad], in [-π, π]."""
    angle: Float = np.arctan2(rotation[..., 1, 0] - rotation[..., 0, 1], rotation[..., 0, 0] + rotation[..., 1, 1])
    return angle


def continuous_heading(quaternion: Float) -> Float:
    """`heading` without jumps of 2π over time, (T, ..., 4) -> (T, ...) [rad]."""
    return np.unwrap(heading(quaternion), axis=0)


def continuous_matrix_heading(rotation: Float) -> Float:
    """`matrix_heading` without jumps of 2π over time, (T, ..., 3, 3) -> (T, ...) [rad]."""
    angle = matrix_heading(rotation)
    # Most motion has no jump, and finding that out is several times as fast.
    return np.unwrap(angle, axis=0) if (np.abs(np.diff(angle, axis=0)) > np.pi).any() else angle


def wrapped(angle: float) -> float:
    """The same angle within half a turn, in [-π, π] [rad]."""
    return math.remainder(angle, math.tau)
