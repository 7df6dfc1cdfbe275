"""`PushWatch`: whether the robot sways as after a push, so that its next foothold must move, from the loop's rows."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from flexmotion.streamer.control.ladder import State
from flexmotion.streamer.control.push_correction import FALLS_M
from flexmotion.streamer.control.tick_row import TickRow

Float = NDArray[np.float64]

_LEAST_M = 0.022
"""A divergent component further from its plan than this is answered [m]: three clips of walks that nobody pushes have
up to 21 mm in mid-swing (99 %: 18 mm)."""
_LIFTED_S = 0.08
"""The robot has stood on one foot for this long [s]: a foot that lands or lifts late sways up to 37 mm before."""
_LANDS_S = 0.144
"""The foot in the air lands no sooner than this, by the plan [s]: later than a plan made now joins, by as long as
`CaptureSteps` needs. Feet that strike early sway too, and a plan that moves nothing cost a walk two of 19 steps."""
_ROWS = 2
"""Rows in a row that must show it."""
_AGREE_M = 0.02
"""Most that two of them may differ by [m]: a push of 1.2 N·s in .1 s moves it by 7 mm a tick."""
_EVERY_S = 0.048
"""Time between two answers, at least [s]: a plan takes 20 ms, and the loop commits to one for 40."""


class PushWatch:
    """Follows the loop's rows.

    Args:
        rate_hz: loop ticks a second.
        turns: ticks within which every joint is read once.

    Attributes:
        sway: divergent component of the robot minus that of its plan, (2,) [m], where it is to be answered now; else
            None.
    """

    def __init__(self, rate_hz: float, turns: int = 1) -> None:
        self._turns = turns
        self._every = round(_EVERY_S * rate_hz)
        self._last, self._seen, self._tick = np.zeros(2), 0, -1
        self._doubted = 0  # readings that were not believed, as of the newest row
        self._lifted, self._stood = round(_LIFTED_S * rate_hz), 0
        self._lands = round(_LANDS_S * rate_hz)
        self.sway: Float | None = None

    def update(self, row: TickRow, asked_tick: int, lands_in: int) -> None:
        """Take account of the newest row; rows in between may be missing.

        Args:
            asked_tick: at which the last plan was made.
            lands_in: ticks until the foot in the air lands, by the plan that plays; 0: none is, or it is not known.
        """
        tick = int(row.tick)
        if tick != self._tick:
            error = row.dcm - row.dcm_ref
            if row.contact_ref.all():
                self._stood = tick
            doubted, self._doubted = int(row.disbelieved) != self._doubted, int(row.disbelieved)
            swayed = self._measured(row) and not doubted and _LEAST_M < math.hypot(*error) < FALLS_M
            agrees = self._seen > 0 and math.hypot(*(error - self._last)) <= _AGREE_M
            self._seen = (self._seen + 1 if agrees else 1) if swayed else 0
            self._last, self._tick = error.copy(), tick
        ready = self._seen >= _ROWS and lands_in >= self._lands and tick + 1 >= asked_tick + self._every
        self.sway = self._last if ready else None

    def _measured(self, row: TickRow) -> bool:
        """Whether a robot that walks is in mid-swing, as planned, and all of it has just been measured."""
        streams = int(row.state) == State.STREAMING and not row.hung and not row.must_stop
        known = int(row.imu_stale) == 0 and bool((row.stale < self._turns).all())
        swings = int(row.tick) - self._stood >= self._lifted
        return bool(streams and known and swings and np.isfinite(row.dcm - row.dcm_ref).all())
