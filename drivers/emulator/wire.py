"""`Wire`: when the bytes of a half-duplex bus come and go at its baud rate."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

from flexmotion.drivers.port import BITS_A_BYTE

FRAME_S = 0.0005
"""Replies that end within this time of the first are handed over together, as a USB adapter does [s]."""


@dataclass(frozen=True)
class Reply:
    """Bytes that a device puts on the wire `delay` [s] after what came before; `id` is for faults on demand."""

    id: int
    delay: float
    data: bytes


class Wire:
    """One bus at a baud rate, or at once where `timed` is False.

    Attributes:
        collisions: times that the host sent while a reply was still on its way.
        busy_s: time that the wire carried bytes [s].
    """

    def __init__(self, *, timed: bool = True) -> None:
        self.timed = timed
        self.collisions = 0
        self.busy_s = 0.0
        self._host_free = self._reply_end = 0.0
        self._last = 0.0
        self._outgoing: deque[tuple[float, bytes]] = deque()  # on the wire
        self._held: deque[tuple[float, bytes]] = deque()  # past the wire, held back by a fault

    def send(self, size: int, baud: int, now: float) -> float:
        """The host sends `size` bytes; when the last one is over. What is left of a reply it destroys."""
        start = max(now, self._host_free)
        if self._outgoing and start < self._reply_end:
            self.collisions += 1
            self._outgoing.clear()
        self.busy_s += size * BITS_A_BYTE / baud
        self._host_free = start + self.seconds(size, baud)
        return self._host_free

    def seconds(self, size: int, baud: int) -> float:
        """Time that `size` bytes take [s]."""
        return size * BITS_A_BYTE / baud if self.timed else 0.0

    def answer(self, replies: list[tuple[Reply, bytes, float]], baud: int, after: float) -> None:
        """Devices answer an instruction that ended at `after`: reply, what is left of it, and extra delay [s].

        Where the host is still sending by then, both speak at once and no reply is left.
        """
        if self._host_free > after:
            self.collisions += 1
            return
        at, frame, frame_end = after, bytearray(), float("inf")
        for reply, data, late in replies:
            took = len(reply.data) * BITS_A_BYTE / baud
            self.busy_s += took
            if self.timed:
                at += reply.delay + took
            if late:
                self._held.append((at + late, data))
                continue
            if frame and at > frame_end:
                self._outgoing.append((self._last, bytes(frame)))
                frame.clear()
            if not frame:
                frame_end = at + FRAME_S
            frame += data
            self._last = at
        if frame:
            self._outgoing.append((self._last, bytes(frame)))
        self._reply_end = at

    @property
    def due(self) -> float | None:
        """When the next bytes reach the host; None where none are on their way."""
        dues = [queue[0][0] for queue in (self._outgoing, self._held) if queue]
        return min(dues) if dues else None

    def take(self, now: float) -> bytes:
        """Bytes that have reached the host by `now`."""
        data = b""
        for queue in (self._held, self._outgoing):
            while queue and queue[0][0] <= now:
                data += queue.popleft()[1]
        return data

    def clear(self) -> None:
        """Nothing more comes."""
        self._outgoing.clear()
        self._held.clear()
