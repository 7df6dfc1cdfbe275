"""`SenderClock`: times of a sender on the clock of this machine."""

from __future__ import annotations

from collections import deque

REMEMBERED_S, SLICE_S = 10.0, 1.0
"""The least delay of this long counts, in slices of this length [s]: clocks drift by less than 1 ms in that time."""
OFF_S = 1.0
"""A time that is off by more is of a clock that was set, or of a sender that was started again [s]."""


class SenderClock:
    """Takes the least delay seen lately for the true one.

    Frames are then apart as they were sent, whatever the network does to them, and none is later than its arrival.
    """

    def __init__(self) -> None:
        self._least: deque[list[float]] = deque()  # [begin of the slice, least of arrival - sent in it]

    def local(self, sent_s: float | None, arrived_s: float) -> float:
        """When a frame was made [s].

        Args:
            sent_s: on the sender's clock; None: unknown, the arrival is taken.
            arrived_s: when it arrived.
        """
        if sent_s is None:
            return arrived_s
        delay = arrived_s - sent_s
        if self._least and abs(delay - self._offset()) > OFF_S:
            self._least.clear()
        if not self._least or arrived_s - self._least[-1][0] > SLICE_S:
            self._least.append([arrived_s, delay])
        self._least[-1][1] = min(self._least[-1][1], delay)
        while self._least[-1][0] - self._least[0][0] > REMEMBERED_S:
            self._least.popleft()
        return sent_s + self._offset()

    def _offset(self) -> float:
        return min(delay for _, delay in self._least)
