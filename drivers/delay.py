"""A delay line: commands take effect a fixed time after they are sent, resolved to fractions of a simulation step."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Float = NDArray[np.float64]


class DelayLine:
    """Delays rows of `width` numbers; holds up to `capacity` rows.

    Attributes:
        value: the row in effect at the end of the last `advance`, (width,).
    """

    def __init__(self, initial: Float, delay: float, capacity: int = 64) -> None:
        """`delay` in seconds. Raises ValueError if it is negative."""
        if not delay >= 0:
            raise ValueError(f"delay is {delay} s, expected 0 or more")
        self.delay = delay
        self.value = np.array(initial, np.float64)
        self._mean = self.value.copy()
        self._rows = np.zeros((capacity, len(self.value)))
        self._due = np.zeros(capacity)
        self._first, self._count = 0, 0
        self._now = 0.0

    def push(self, row: Float) -> None:
        """Send a row now. If the line is full, the oldest row takes effect early."""
        if self._count == len(self._due):
            self._take()
        slot = (self._first + self._count) % len(self._due)
        self._rows[slot] = row
        self._due[slot] = self._now + self.delay
        self._count += 1

    def reset(self, row: Float) -> None:
        """Put a row into effect now and drop the delayed ones."""
        self._count = 0
        self.value[:] = row

    def overwrite(self, columns: NDArray[np.int64], values: Float) -> None:
        """Set some numbers of the row in effect and of all delayed ones."""
        self.value[columns] = values
        self._rows[:, columns] = values

    def advance(self, seconds: float) -> Float:
        """Let time pass; the mean over that time of the row in effect, (width,). Valid until the next call."""
        end = self._now + seconds
        if not self._count or self._due[self._first] >= end:
            self._now = end
            return self.value
        self._mean.fill(0.0)
        at = self._now
        while self._count and self._due[self._first] < end:
            due = max(self._due[self._first], at)
            self._mean += self.value * ((due - at) / seconds)
            at = due
            self._take()
        self._mean += self.value * ((end - at) / seconds)
        self._now = end
        return self._mean

    def _take(self) -> None:
        self.value[:] = self._rows[self._first]
        self._first = (self._first + 1) % len(self._due)
        self._count -= 1
