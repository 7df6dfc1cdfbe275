"""The path of a foot during a step."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from flexmotion.spatial.transitions import minimum_jerk, smoothstep

Float = NDArray[np.float64]

_CUBIC_SHARE = 0.7
"""Share of a cubic, which keeps the top speed low; the rest is minimum jerk, which lands softly. This mix saturated the
knee servos least."""
PEAK_ACCELERATION = _CUBIC_SHARE * 6.0 + (1.0 - _CUBIC_SHARE) * 10.0 / np.sqrt(3.0)
"""Greatest acceleration along the path, times duration squared over distance (upper bound of the mix)."""


def swing_path(phase: Float, start: Float, target: Float, clearance: float) -> Float:
    """Sole centre and yaw during a swing.

    Args:
        phase: 0 at lift-off, 1 at touch-down, (T,).
        start, target: x, y, z, yaw, (4,) [m, m, m, rad].
        clearance: greatest height of the path over the straight line [m].

    Returns:
        (T, 4) [m, m, m, rad].
    """
    s = np.clip(phase, 0.0, 1.0)
    quintic = minimum_jerk(s)
    progress = _CUBIC_SHARE * smoothstep(s) + (1.0 - _CUBIC_SHARE) * quintic
    path = start + np.outer(progress, target - start)
    path[:, 2] = start[2] + quintic * (target[2] - start[2]) + clearance * 16.0 * (s * (1.0 - s)) ** 2
    path[:, 3] = start[3] + quintic * (target[3] - start[3])
    return path
