"""`PushWatch`: whether the robot sways as after a push, from the loop's rows.

The next foothold must move, or the foot over whose edge the robot leans must stay down.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from flexmotion.retarget.push_rest import LEAN_M, outward
from flexmotion.retarget.steps import NOTICE_S
from flexmotion.streamer.control.ladder import State
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
_MOST_M = 0.15
"""One that is further away is no sway of a robot that stands on its feet: a wrong reading, or a fall [m]."""
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
        lean: likewise, where it leads outward over the foot on the ground that lifts next, whose step is settled.
    """

    def __init__(self, rate_hz: float, turns: int = 1) -> None:
        self._turns = turns
        self._every = round(_EVERY_S * rate_hz)
        self._last, self._seen, self._leant, self._tick = np.zeros(2), 0, 0, -1
        self._doubted = 0  # readings that were not believed, as of the newest row
        self._lifted, self._stood = round(_LIFTED_S * rate_hz), 0
        self._lands, self._settled = round(_LANDS_S * rate_hz), round(NOTICE_S * rate_hz)
        self.sway: Float | None = None
        self.lean: Float | None = None

    @property
    def calls(self) -> bool:
        """Whether a plan is to answer."""
        return self.sway is not None or self.lean is not None

    def update(self, row: TickRow, asked_tick: int, lands_in: int, lifts_in: tuple[int, int] = (0, 0)) -> None:
        """Take account of the newest row; rows in between may be missing.

        Args:
            asked_tick: at which the last plan was made.
            lands_in: ticks until the foot in the air lands, by the plan that plays; 0: none is, or it is not known.
            lifts_in: the foot on the ground that lifts next, and ticks until then; 0 ticks: none does.
        """
        tick = int(row.tick)
        if tick != self._tick:
            error = row.dcm - row.dcm_ref
            if row.contact_ref.all():
                self._stood = tick
            doubted, self._doubted = int(row.disbelieved) != self._doubted, int(row.disbelieved)
            size = math.hypot(*error)
            measured = self._measured(row) and not doubted and size < _MOST_M
            swayed = measured and size > _LEAST_M and tick - self._stood >= self._lifted
            side, until = lifts_in
            leant = measured and 0 < until <= self._settled and outward(error, side, row.foot_ref[side, 3]) > LEAN_M
            agrees = math.hypot(*(error - self._last)) <= _AGREE_M
            self._seen = (self._seen * agrees + 1) * swayed
            self._leant = (self._leant * agrees + 1) * leant
            self._last, self._tick = error.copy(), tick
        ready = tick + 1 >= asked_tick + self._every
        self.sway = self._last if ready and self._seen >= _ROWS and lands_in >= self._lands else None
        self.lean = self._last if ready and self._leant >= _ROWS else None

    def _measured(self, row: TickRow) -> bool:
        """Whether a robot that walks has just been measured, all of it."""
        streams = int(row.state) == State.STREAMING and not row.hung and not row.must_stop
        known = int(row.imu_stale) == 0 and bool((row.stale < self._turns).all())
        return bool(streams and known and np.isfinite(row.dcm - row.dcm_ref).all())
