"""`Wire`: timing of bytes on a half-duplex bus."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

from flexmotion.drivers.port import BITS_A_BYTE

FRAME_S = 0.0005
"""Replies that end within this time of the first are delivered together, as by a USB adapter [s]."""


@dataclass(frozen=True)
class Reply:
    """Bytes that a device sends `delay` [s] after the bytes before; `id` is the device's."""

    id: int
    delay: float
    data: bytes


def collide(replies: Sequence[Reply]) -> Reply:
    """What the host receives where several devices answer at once: a low bit on the wire wins over a high one."""
    longest = max(replies, key=lambda reply: len(reply.data))
    mixed = bytearray(longest.data)
    for reply in replies:
        for at, byte in enumerate(reply.data):
            mixed[at] &= byte
    return Reply(longest.id, min(reply.delay for reply in replies), bytes(mixed))


def mix(answers: Sequence[Sequence[Reply]]) -> list[Reply]:
    """Answers of several devices with the same ids to one request; those with one id collide."""
    slots: dict[int, list[Reply]] = {}
    for reply in (reply for replies in answers for reply in replies):
        slots.setdefault(reply.id, []).append(reply)
    return [slot[0] if len(slot) == 1 else collide(slot) for slot in slots.values()]


class Wire:
    """The wire of one bus; without `timed`, bytes take no time.

    Attributes:
        collisions: number of times that the host sent during a reply, or a device during a request.
        busy_s: time that the wire carried bytes [s].
    """

    def __init__(self, *, timed: bool = True) -> None:
        self.timed = timed
        self.collisions = 0
        self.busy_s = 0.0
        self._host_free = self._reply_end = 0.0
        self._last = 0.0
        self._outgoing: deque[tuple[float, bytes]] = deque()  # on the wire
        self._held: deque[tuple[float, bytes]] = deque()  # delayed by a fault

    def send(self, size: int, baud: int, now: float) -> float:
        """The host sends `size` bytes; the time at which the last one leaves the wire [s]. A pending reply is lost."""
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

    def echo(self, data: bytes, end: float) -> None:
        """The adapter returns what the host has sent by `end` [s]."""
        self._held.append((end, data))

    def answer(self, replies: list[tuple[Reply, bytes, float]], baud: int, after: float) -> None:
        """Devices answer a request that ended at `after` [s].

        If the host is still sending, the answers are lost in the collision.

        Args:
            replies: each reply, its bytes after damage, and its extra delay [s].
            baud: bit rate.
            after: end of the request [s].
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
        """Time at which the next bytes reach the host [s]; None: no bytes are on the wire."""
        dues = [queue[0][0] for queue in (self._outgoing, self._held) if queue]
        return min(dues) if dues else None

    def take(self, now: float) -> bytes:
        """Bytes that have reached the host by `now` [s]."""
        data = b""
        for queue in (self._held, self._outgoing):
            while queue and queue[0][0] <= now:
                data += queue.popleft()[1]
        return data

    def clear(self) -> None:
        """Discard all bytes on the wire."""
        self._outgoing.clear()
        self._held.clear()
