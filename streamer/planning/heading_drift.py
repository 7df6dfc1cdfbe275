"""`HeadingDrift`: how far the robot has turned from where its plans have it, by its odometry."""

from __future__ import annotations

import math

from flexmotion.streamer.control.estimator import yaw_of
from flexmotion.streamer.control.tick_row import TickRow

_SMOOTH_S = 0.5
"""Time constant: joints and soles yield by a few degrees in every step, and come back."""


class HeadingDrift:
    """Follows the loop's rows.

    Args:
        rate_hz: loop ticks a second.

    Attributes:
        value: turn of the torso beyond that of the plans, smoothed, up to a constant [rad]; NaN while none plays.
    """

    def __init__(self, rate_hz: float) -> None:
        self._ticks = _SMOOTH_S * rate_hz
        self._tick = 0
        self.value = math.nan

    def update(self, row: TickRow) -> None:
        """Take account of the newest row; rows in between may be missing."""
        turned = float(row.odometry[2]) - yaw_of(row.base_ref[3:])
        tick, since = int(row.tick), int(row.tick) - self._tick
        self._tick = tick
        if not row.plan or not math.isfinite(turned):
            self.value = math.nan
        elif math.isnan(self.value) or since < 0:
            self.value = turned
        else:
            share = -math.expm1(-since / self._ticks)
            self.value += share * math.remainder(turned - self.value, math.tau)
