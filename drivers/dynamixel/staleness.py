"""`ReplyClock`: detects answers that arrive a tick late, by the servos' own millisecond counters."""

from __future__ import annotations

from collections.abc import Sequence
from operator import eq

_UNITS = 32
"""Units per millisecond; 13 bits of such units wrap with the low byte of the counter."""

_CREEP = 2
"""Largest correction of a servo's clock offset per cycle [units]: follows 7,000 ppm at 125 Hz."""

FORGET_S = 0.1
"""Time without an answer after which the low byte of the counter is ambiguous [s]."""

_NEWEST = 40 * _UNITS
"""An answer may look newer than usual by this, if the request was delayed [units]."""

_HALF = 128 * _UNITS
_MASK = 2 * _HALF - 1


class ReplyClock:
    """Offsets between the host's clock and the low bytes of the realtime ticks of m servos.

    The counter in an old answer is behind the time that has passed since earlier answers. Plain integers: for some
    tens of servos, numpy's calls take several times as long.

    Args:
        m: number of servos.
        oldest_ms: an answer that is older than usual by this is refused [ms].
    """

    def __init__(self, m: int, oldest_ms: float) -> None:
        self._oldest = round(oldest_ms * _UNITS)
        self._every = list(range(m))
        self._offset, self._known, self._tick = [0] * m, [False] * m, [-1] * m
        self._answered, self._accepted = [0.0] * m, [0.0] * m

    def begin(self) -> None:
        """Start learning: all answers are accepted, and the one with the largest delay sets the offset."""
        self._known = [False] * len(self._known)

    def learn(self, slots: Sequence[int], ticks: bytes, now: float) -> None:
        """Learn from the answers of a bus at rest to a request sent at `now` [s]; `ticks`: a counter for each slot."""
        units = _units(now)
        for slot, tick in zip(slots, ticks, strict=True):
            offset = units - tick * _UNITS
            if self._known[slot]:
                offset = self._offset[slot] + max(_wrapped(offset - self._offset[slot]), 0)
            self._offset[slot], self._known[slot], self._tick[slot] = offset, True, tick
            self._answered[slot] = self._accepted[slot] = now

    def accept(self, slots: Sequence[int], ticks: bytes, now: float) -> list[bool]:
        """Which of the answers to a request sent at `now` [s] are fresh, in the order of `slots`."""
        units, forgotten, oldest = _units(now), now - FORGET_S, self._oldest
        if slots == self._every and min(self._accepted) >= forgotten:
            # The usual answer, of all servos in order.
            pairs = zip(ticks, self._offset, strict=True)
            late = [((units - tick * _UNITS - at + _HALF) & _MASK) - _HALF for tick, at in pairs]
            if min(late) > -_NEWEST and max(late) < oldest and not any(map(eq, ticks, self._tick)):
                self._offset = [
                    at + (own if -_CREEP <= own <= _CREEP else _CREEP if own > 0 else -_CREEP)
                    for own, at in zip(late, self._offset, strict=True)
                ]
                self._tick = list(ticks)
                self._answered, self._accepted = [now] * len(slots), [now] * len(slots)
                return [True] * len(slots)
        found = []
        for slot, tick in zip(slots, ticks, strict=True):
            own = _wrapped(units - tick * _UNITS - self._offset[slot])
            if self._accepted[slot] < forgotten:
                # The offset is no longer known: two answers must agree on the time between them.
                since = now - self._answered[slot]
                passed = int(since * 1e3 * _UNITS) - (tick - self._tick[slot]) * _UNITS
                fresh, step = abs(_wrapped(passed)) < oldest and since < FORGET_S, own
            else:
                fresh, step = -_NEWEST < own < oldest, min(max(own, -_CREEP), _CREEP)
            fresh = fresh and tick != self._tick[slot]
            if fresh:
                self._offset[slot] += step
                self._accepted[slot] = now
            self._tick[slot], self._answered[slot] = tick, now
            found.append(fresh)
        return found


def _units(seconds: float) -> int:
    return round(seconds * 1e3 * _UNITS)


def _wrapped(units: int) -> int:
    """The same modulo 256 ms, in [-128, 128) ms."""
    return ((units + _HALF) & _MASK) - _HALF
