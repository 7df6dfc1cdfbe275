"""`ReplyClock`: tells an answer of now from one that comes a tick late, by the servos' own millisecond counters."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Slots = NDArray[np.int64]

_UNITS = 32
"""Time is counted in whole 32nds of a millisecond: 13 bits of it wrap with the counter's byte."""

_CREEP = 2
"""How far a cycle may move the estimate of a servo's clock [units]: follows 7,000 ppm at 125 Hz."""

FORGET_S = 0.1
"""Past this time without an answer the counter's low byte says nothing any more [s]."""

_NEWEST_MS = 40
"""An answer may seem newer than usual by this: the request took longer on its way [ms]."""


class ReplyClock:
    """Offsets between the host's clock and the low bytes of m realtime ticks.

    An old answer shows a counter that is behind what the time since other answers says.

    Args:
        m: servos.
        oldest_ms: an answer that is older by this than usual is refused [ms].
    """

    def __init__(self, m: int, oldest_ms: float) -> None:
        self._oldest = round(oldest_ms * _UNITS)
        self._offset = np.zeros(m, np.int64)
        self._known = np.zeros(m, np.bool_)
        self._tick = np.full(m, -1, np.int64)
        self._heard, self._accepted = np.zeros(m), np.zeros(m)

    def begin(self) -> None:
        """Learn anew: the next answers are taken as they come, and the oldest-looking of them counts."""
        self._known.fill(False)

    def learn(self, slots: Slots | slice, tick: Slots, now: float) -> None:
        """Answers of a bus at rest to requests sent at `now` [s]."""
        offset = _units(now) - tick * _UNITS
        known = self._known[slots]
        ahead = np.maximum(_wrapped(offset - self._offset[slots]), 0)
        self._offset[slots] = np.where(known, self._offset[slots] + ahead, offset)
        self._known[slots] = True
        self._tick[slots], self._heard[slots], self._accepted[slots] = tick, now, now

    def accept(self, slots: Slots | slice, tick: Slots, now: float) -> NDArray[np.bool_]:
        """Which of the answers to a request sent at `now` [s] are of now, in the order of `slots`."""
        late = _wrapped(_units(now) - tick * _UNITS - self._offset[slots])
        fresh = (late > -_NEWEST_MS * _UNITS) & (late < self._oldest)
        step = np.minimum(np.maximum(late, -_CREEP), _CREEP)
        out_of_touch = self._accepted[slots] < now - FORGET_S
        if out_of_touch.any():
            # The offset says nothing any more: two answers must agree on how much time passed between them.
            since = now - self._heard[slots]
            passed = (since * 1e3 * _UNITS).astype(np.int64) - (tick - self._tick[slots]) * _UNITS
            agrees = (np.abs(_wrapped(passed)) < self._oldest) & (since < FORGET_S)
            fresh, step = np.where(out_of_touch, agrees, fresh), np.where(out_of_touch, late, step)
        fresh &= tick != self._tick[slots]
        self._offset[slots] += step * fresh
        self._tick[slots], self._heard[slots] = tick, now
        self._accepted[slots] = np.where(fresh, now, self._accepted[slots])
        return fresh


def _units(seconds: float) -> int:
    return round(seconds * 1e3 * _UNITS)


def _wrapped(units: Slots) -> Slots:
    """The same modulo 256 ms, in [-128, 128) ms."""
    half = 128 * _UNITS
    return ((units + half) & (2 * half - 1)) - half
