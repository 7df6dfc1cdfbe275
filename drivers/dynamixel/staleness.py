"""`ReplyClock`: detects answers that arrive a tick late, by the servos' own millisecond counters."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Slots = NDArray[np.int64]

_UNITS = 32
"""Units per millisecond; 13 bits of such units wrap with the low byte of the counter."""

_CREEP = 2
"""Largest correction of a servo's clock offset per cycle [units]: follows 7,000 ppm at 125 Hz."""

FORGET_S = 0.1
"""Time without an answer after which the low byte of the counter is ambiguous [s]."""

_NEWEST_MS = 40
"""An answer may look newer than usual by this, if the request was delayed [ms]."""


class ReplyClock:
    """Offsets between the host's clock and the low bytes of the realtime ticks of m servos.

    The counter in an old answer is behind the time that has passed since earlier answers.

    Args:
        m: number of servos.
        oldest_ms: an answer that is older than usual by this is refused [ms].
    """

    def __init__(self, m: int, oldest_ms: float) -> None:
        self._oldest = round(oldest_ms * _UNITS)
        self._offset = np.zeros(m, np.int64)
        self._known = np.zeros(m, np.bool_)
        self._tick = np.full(m, -1, np.int64)
        self._answered, self._accepted = np.zeros(m), np.zeros(m)

    def begin(self) -> None:
        """Start learning: all answers are accepted, and the one with the largest delay sets the offset."""
        self._known.fill(False)

    def learn(self, slots: Slots | slice, tick: Slots, now: float) -> None:
        """Learn from the answers of a bus at rest to a request sent at `now` [s]."""
        offset = _units(now) - tick * _UNITS
        known = self._known[slots]
        ahead = np.maximum(_wrapped(offset - self._offset[slots]), 0)
        self._offset[slots] = np.where(known, self._offset[slots] + ahead, offset)
        self._known[slots] = True
        self._tick[slots], self._answered[slots], self._accepted[slots] = tick, now, now

    def accept(self, slots: Slots | slice, tick: Slots, now: float) -> NDArray[np.bool_]:
        """Which of the answers to a request sent at `now` [s] are fresh, in the order of `slots`."""
        late = _wrapped(_units(now) - tick * _UNITS - self._offset[slots])
        fresh = (late > -_NEWEST_MS * _UNITS) & (late < self._oldest)
        step = np.minimum(np.maximum(late, -_CREEP), _CREEP)
        unknown = self._accepted[slots] < now - FORGET_S
        if unknown.any():
            # The offset is no longer known: two answers must agree on the time between them.
            since = now - self._answered[slots]
            passed = (since * 1e3 * _UNITS).astype(np.int64) - (tick - self._tick[slots]) * _UNITS
            agrees = (np.abs(_wrapped(passed)) < self._oldest) & (since < FORGET_S)
            fresh, step = np.where(unknown, agrees, fresh), np.where(unknown, late, step)
        fresh &= tick != self._tick[slots]
        self._offset[slots] += step * fresh
        self._tick[slots], self._answered[slots] = tick, now
        self._accepted[slots] = np.where(fresh, now, self._accepted[slots])
        return fresh


def _units(seconds: float) -> int:
    return round(seconds * 1e3 * _UNITS)


def _wrapped(units: Slots) -> Slots:
    """The same modulo 256 ms, in [-128, 128) ms."""
    half = 128 * _UNITS
    return ((units + half) & (2 * half - 1)) - half
