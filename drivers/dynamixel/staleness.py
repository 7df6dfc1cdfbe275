"""`ReplyClock`: tells an answer of now from one that comes a tick late, by the servos' own millisecond counters."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Float = NDArray[np.float64]

_CREEP_MS = 0.05
"""How far a cycle may move the estimate of a servo's clock: follows 6,000 ppm at 125 Hz."""

FORGET_S = 0.1
"""Past this time without an answer the counter's low byte says nothing any more [s]."""

_NEWEST_MS = 40.0
"""An answer may seem newer than usual by this: the request took longer on its way [ms]."""


class ReplyClock:
    """Offsets between the host's clock and the low bytes of m realtime ticks.

    An old answer shows a counter that is behind what the time since other answers says.

    Args:
        m: servos.
        oldest_ms: an answer that is older by this than usual is refused [ms].
    """

    def __init__(self, m: int, oldest_ms: float) -> None:
        self._oldest = oldest_ms
        self._offset = np.full(m, np.nan)
        self._tick, self._heard, self._accepted = np.full(m, -1.0), np.zeros(m), np.zeros(m)

    def begin(self) -> None:
        """Learn anew: the next answers are taken as they come, and the oldest-looking of them counts."""
        self._offset.fill(np.nan)

    def learn(self, slots: NDArray[np.int64], tick: Float, now: float) -> None:
        """Answers of a bus at rest to requests sent at `now` [s]."""
        offset = now * 1e3 - tick
        known = ~np.isnan(self._offset[slots])
        ahead = _wrapped(offset - np.where(known, self._offset[slots], offset))
        self._offset[slots] = np.where(known, self._offset[slots] + np.maximum(ahead, 0.0), offset)
        self._tick[slots], self._heard[slots], self._accepted[slots] = tick, now, now

    def accept(self, slots: NDArray[np.int64], tick: Float, now: float) -> NDArray[np.bool_]:
        """Which of the answers to a request sent at `now` [s] are of now, in the order of `slots`."""
        late = _wrapped(now * 1e3 - tick - self._offset[slots])
        in_time = (late > -_NEWEST_MS) & (late < self._oldest)
        # Out of touch for so long that the offset says nothing: two answers must agree on how much time passed.
        since = now - self._heard[slots]
        agrees = np.abs(_wrapped(since * 1e3 - (tick - self._tick[slots]))) < self._oldest
        out_of_touch = now - self._accepted[slots] > FORGET_S
        fresh = (tick != self._tick[slots]) & np.where(out_of_touch, agrees & (since < FORGET_S), in_time)
        step = np.where(out_of_touch, late, np.clip(late, -_CREEP_MS, _CREEP_MS))
        self._offset[slots] += np.where(fresh, step, 0.0)
        self._tick[slots], self._heard[slots] = tick, now
        self._accepted[slots[fresh]] = now
        return fresh


def _wrapped(milliseconds: Float) -> Float:
    """The same modulo 256, in [-128, 128)."""
    return np.mod(milliseconds + 128.0, 256.0) - 128.0
