"""Unit quaternions over time."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Float = NDArray[np.float64]


def continuous_quaternions(quaternions: Float) -> Float:
    """The same rotations with signs such that neighbours in time have a scalar product of 0 or more, (T, ..., 4)."""
    flips = np.sum(quaternions[1:] * quaternions[:-1], axis=-1) < 0
    sign = np.where(np.cumsum(flips, axis=0) % 2, -1.0, 1.0)
    return np.concatenate([quaternions[:1], quaternions[1:] * sign[..., None]])
