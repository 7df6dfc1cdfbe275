"""`OneEuro`: causal low-pass whose cut-off rises with speed: little jitter at rest, little lag in motion.

Casiez, Roussel, Vogel 2012, "1 € Filter", CHI, equations 1 to 4.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Float = NDArray[np.float64]

SPEED_CUTOFF_HZ = 1.0
"""Cut-off of the speed that sets the cut-off (the paper's constant) [Hz]."""


class OneEuro:
    """Filters points of a stream at even intervals.

    Args:
        least_hz: cut-off at rest [Hz].
        slope: added to it by speed [Hz per m/s].
        fps: frames a second.
    """

    def __init__(self, least_hz: float, slope: float, fps: float) -> None:
        self._least_hz, self._slope, self._fps = least_hz, slope, fps
        self._value: Float | None = None
        self._velocity: Float = np.zeros(0)

    def __call__(self, points: Float) -> Float:
        """The filtered points of the next frame, (J, 3) [m]; a point that is NaN is skipped."""
        if self._value is None:
            self._value, self._velocity = points.copy(), np.zeros_like(points)
            return points
        known = np.isfinite(self._value)
        moved = np.where(np.isfinite(points) & known, points - self._value, 0.0)
        share = _share(np.full((len(points), 1), SPEED_CUTOFF_HZ), self._fps)
        self._velocity = self._velocity + share * (moved * self._fps - self._velocity)
        speed = np.linalg.norm(self._velocity, axis=1, keepdims=True)
        filtered = self._value + _share(self._least_hz + self._slope * speed, self._fps) * moved
        self._value = np.where(known, filtered, points)
        return np.where(np.isfinite(points), self._value, np.nan)


def _share(cutoff_hz: Float, fps: float) -> Float:
    """Weight of the newest value in a first-order low-pass."""
    radians = 2.0 * np.pi * cutoff_hz / fps
    share: Float = radians / (radians + 1.0)
    return share
