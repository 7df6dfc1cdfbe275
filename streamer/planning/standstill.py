"""`measured_place`, `Standstill`: where a robot stands by its own odometry, and when it has come to rest."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from flexmotion.streamer.control.estimator import yaw_of
from flexmotion.streamer.control.tick_row import TickRow

Float = NDArray[np.float64]

TURN_AHEAD_S, WALK_AHEAD_S = 0.05, 0.2
"""A robot that is to stop turns and walks on for about this long at its speed [s]."""
SPEED_S = 1.0
"""The speed is the mean over this time [s]: the torso sways with every step."""
STILL_S = 0.5
"""What has not moved for this long rests [s]."""
SETTLE_S, LONGEST_SETTLE_S = 1.0, 4.0
"""After a walk or a turn the robot stands at least and at most this long before it is measured [s]."""
_STILL_M, _STILL_RAD = 0.008, np.radians(1.5)
"""It stands still when it has moved less than this in `STILL_S` [m, rad]."""


def measured_place(row: TickRow) -> Float:
    """Where the robot stands if it stops now: odometry x, y [m] and the heading of its feet [rad], (3,).

    The torso turns ahead of the feet, and back to them where it stops: a turn that ended with the torso's heading
    made no step and turned back. The feet's heading is the torso's, as measured, less its planned twist.
    """
    place = np.nan_to_num(np.array(row.odometry, float))
    torso, feet = yaw_of(row.base_ref[3:]), row.foot_ref[:, 3]
    if math.isfinite(torso) and np.isfinite(feet).all():
        middle = feet[0] + 0.5 * math.remainder(feet[1] - feet[0], math.tau)
        place[2] -= math.remainder(torso - middle, math.tau)
    return place


class Standstill:
    """Args: odometry (3,) [m, m, rad] and time [s] at which the robot was told to stand."""

    def __init__(self, place: Float, time_s: float) -> None:
        self._begin_s = self._still_s = time_s
        self._place = np.array(place, float)

    def settled(self, place: Float, time_s: float) -> bool:
        """Whether it rests, given its odometry now; after `LONGEST_SETTLE_S` it counts as resting."""
        moved = np.abs(place - self._place)
        if moved[:2].max() > _STILL_M or moved[2] > _STILL_RAD:
            self._still_s, self._place = time_s, np.array(place, float)
        since_s = time_s - self._begin_s
        return since_s >= LONGEST_SETTLE_S or (since_s >= SETTLE_S and time_s - self._still_s >= STILL_S)
