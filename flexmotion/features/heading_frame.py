"""The frame of features: on the floor below the pelvis, x along its heading, z up."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Float = NDArray[np.float64]


def yaw_matrix(yaw: Float) -> Float:
    """Rotations about z, (...,) [rad] -> (..., 3, 3)."""
    found = np.zeros((*np.shape(yaw), 3, 3))
    found[..., 0, 0] = found[..., 1, 1] = np.cos(yaw)
    found[..., 1, 0] = sine = np.sin(yaw)
    found[..., 0, 1] = -sine
    found[..., 2, 2] = 1.0
    return found


def turned(vector: Float, yaw: Float) -> Float:
    """Vectors turned about z, (T, ..., 3) by (T,) [rad]."""
    cosine, sine = np.cos(yaw), np.sin(yaw)
    shape = (len(vector), *[1] * (vector.ndim - 2))
    cosine, sine = cosine.reshape(shape), sine.reshape(shape)
    x, y, z = vector[..., 0], vector[..., 1], vector[..., 2]
    ahead = cosine * x - sine * y
    found = np.empty((*ahead.shape, 3), ahead.dtype)
    found[..., 0], found[..., 1], found[..., 2] = ahead, sine * x + cosine * y, z
    return found


def chord(forward: float, left: float, turning: float, seconds: float) -> tuple[float, float]:
    """Mean velocity in the initial heading of a motion whose velocity is constant in its own heading.

    Along an arc of angle ω T: R(ω T / 2) v sin(ω T / 2) / (ω T / 2).

    Args:
        forward, left: in the own heading [m/s].
        turning: positive to the left [rad/s].
        seconds: duration.

    Returns:
        Forward and left [m/s].
    """
    half = 0.5 * turning * seconds
    shorter = float(np.sinc(half / np.pi))
    cosine, sine = shorter * float(np.cos(half)), shorter * float(np.sin(half))
    return cosine * forward - sine * left, sine * forward + cosine * left
