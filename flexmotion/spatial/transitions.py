"""Smooth transitions: from 0 to 1, and from a distance to rest."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

Float = NDArray[np.float64]


def smoothstep(value: Float, low: float = 0.0, high: float = 1.0) -> Float:
    """0 below `low`, 1 above `high`, the cubic 3 s² - 2 s³ between: zero slope at both ends, (...)."""
    s = _within_unit((value - low) / (high - low))
    return s * s * (3 - 2 * s)


def minimum_jerk(s: Float) -> Float:
    """The quintic 10 s³ - 15 s⁴ + 6 s⁵ for s clipped to [0, 1], (...): zero slope and curvature at both ends."""
    s = _within_unit(s)
    return s * s * s * (10.0 + s * (6.0 * s - 15.0))


def decaying(off: NDArray[Any], speed: NDArray[Any], rate: float, time: NDArray[Any]) -> NDArray[Any]:
    """What is left of a distance and its speed after a time, critically damped, (T, n).

        (x + (v + y x) t) exp(-y t)

    Args:
        off: distance x at time 0, (n,).
        speed: its derivative v, (n,).
        rate: y, the inverse of the time constant.
        time: t, (T, 1).
    """
    found: NDArray[Any] = (off + (speed + rate * off) * time) * np.exp(-rate * time)
    return found


def _within_unit(s: Float) -> Float:
    """What `np.clip(s, 0, 1)` gives, in half of its time."""
    found: Float = np.minimum(np.maximum(s, 0.0), 1.0)
    return found
