"""`stopping_place`, `LastRest`, `Standstill`: where a robot stands by its own odometry, and when it came to rest."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from flexmotion.retarget.walk import between
from flexmotion.streamer.control.estimator import yaw_of
from flexmotion.streamer.control.tick_row import TickRow
from flexmotion.streamer.planning.robot_size import RobotSize

Float = NDArray[np.float64]

STILL_S = 0.5
"""What has not moved for this long rests [s]."""
SETTLE_S, LONGEST_SETTLE_S = 1.0, 4.0
"""After a walk or a turn the robot stands at least and at most this long before it is measured [s]."""
_STILL_RAD = np.radians(1.5)
"""It stands still when it has turned by less than this in `STILL_S`, and moved by less than `RobotSize.still` [rad]."""


def stopping_place(row: TickRow, stands_at: Callable[[], Float] | None) -> Float:
    """Where the robot will stand in its odometry if it stops now: x, y [m] and heading [rad], (3,).

    It is where it is now, as measured, and what its plan has left of way and turn: steps that are settled are made, and
    the feet close. Torso and centre of mass sway by more than what is asked for and turn back.

    Args:
        row: newest one of the loop.
        stands_at: gives where a stop ends in the plan's world (`Retargeter.stands_at`); None: where the robot is now.
    """
    place = np.array(row.odometry, float)
    place[np.isnan(place)] = 0.0
    torso = yaw_of(row.base_ref[3:])
    if stands_at is None or not math.isfinite(torso) or not np.isfinite(row.com_ref).all():
        return place
    x, y, heading = stands_at()
    dx, dy = x - row.com_ref[0], y - row.com_ref[1]
    turn = place[2] - torso
    cos, sin = math.cos(turn), math.sin(turn)
    place += [cos * dx - sin * dy, sin * dx + cos * dy, math.remainder(heading - torso, math.tau)]
    return place


class LastRest:
    """Where a robot rested before the step that it makes: a program's first step may be under way when it begins.

    Args:
        rate_hz: ticks a second.
    """

    def __init__(self, rate_hz: float) -> None:
        self._rests_ticks = STILL_S * rate_hz
        self._down = np.zeros(2, np.bool_)
        self._down_since: int | None = None
        self._steps = 0
        self._place: Float | None = None

    def update(self, row: TickRow) -> None:
        """Take the newest row of the loop; rows between two steps may have been missed."""
        down = np.array(row.contact_ref, np.bool_)
        if not down.any():  # no plan plays: the next one's odometry may begin anew
            self._place = None
        self._steps += bool((self._down & ~down).any())
        self._down = down
        if not down.all():
            self._down_since = None
            return
        tick = int(row.tick)
        if self._down_since is None:
            self._down_since = tick
        if tick - self._down_since >= self._rests_ticks and np.isfinite(row.odometry).all():
            self._steps, self._place = 0, stopping_place(row, lambda: between(row.foot_ref))

    @property
    def place(self) -> Float | None:
        """As of `stopping_place`, (3,); None where it is not known, or more than one step has begun since."""
        return None if self._place is None or self._steps > 1 else self._place.copy()


class Closing:
    """Tells when to stop: what a robot does grows by whole steps, and it stops at the one that ends nearest."""

    def __init__(self) -> None:
        self._missing, self._step = math.inf, 0.0

    def reached(self, missing: float) -> bool:
        """Whether the next step would end further from the goal than the robot if it stops now.

        Args:
            missing: what would be missing then, [m] or [rad]; below 0: too much is done.
        """
        if math.isfinite(self._missing):
            self._step = max(self._step, self._missing - missing)
        self._missing = missing
        return missing <= 0.5 * self._step


class Standstill:
    """Args: odometry (3,) [m, m, rad] and time [s] at which the robot was told to stand, and its size."""

    def __init__(self, place: Float, time_s: float, size: RobotSize) -> None:
        self._begin_s = self._still_s = time_s
        self._still_m = size.still
        self._place = np.array(place, float)

    def settled(self, place: Float, time_s: float) -> bool:
        """Whether it rests, given its odometry now; after `LONGEST_SETTLE_S` it counts as resting."""
        moved = np.abs(place - self._place)
        if moved[:2].max() > self._still_m or moved[2] > _STILL_RAD:
            self._still_s, self._place = time_s, np.array(place, float)
        since_s = time_s - self._begin_s
        return since_s >= LONGEST_SETTLE_S or (since_s >= SETTLE_S and time_s - self._still_s >= STILL_S)
