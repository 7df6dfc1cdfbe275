"""`Line`: what hangs behind one emulated port: bytes in, wire time, faults, bytes out. `BusLine`: a servo bus."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Protocol

from flexmotion.drivers.emulator.faults import Damage, Fault, FaultKind
from flexmotion.drivers.emulator.wire import Reply, Wire

SILENCE_S = 0.02
"""Bytes of a packet that is not complete are forgotten after this time without more [s]."""


class EmulatedBus(Protocol):
    """Devices of one protocol that share a wire.

    Attributes:
        dead: ids that hear and say nothing.
        received: whole packets that came from the host.
        imu_ids: of the inertial sensors among them.
    """

    dead: set[int]
    received: int
    imu_ids: frozenset[int]

    @property
    def bad(self) -> int:
        """Broken packets that came from the host."""

    def may_be_answered(self, data: bytes) -> bool:
        """Whether bytes from the host may ask for an answer: true unless it is sure that they do not."""

    def receive(self, data: bytes, baud: int, now: float) -> list[tuple[int, list[Reply]]]:
        """Bytes from the host at `baud`: for every packet in them, its size in bytes and the answers to it."""

    def drop_incomplete(self) -> None:
        """Nothing came for a while: what was not complete never will be."""

    def watch(self, now: float) -> None:
        """Let hardware errors and watchdogs act; called as time passes."""

    def reset(self, id_: int, now: float) -> None:
        """A servo loses power for a moment."""


class Port(Protocol):
    """The emulator's end of a serial port.

    Attributes:
        path: what the client opens.
        open: whether the port is still there.
        descriptor: for `select`; -1 where there is none.
    """

    path: str
    open: bool
    descriptor: int

    @property
    def baud(self) -> int:
        """Bit rate that the client has set."""

    def read(self) -> bytes:
        """What the client wrote since the last call."""

    def write(self, data: bytes) -> None:
        """Give bytes to the client."""

    def close(self) -> None:
        """The port is gone, for its client too."""


class Line(ABC):
    """What hangs behind one emulated port.

    Attributes:
        name: it goes by.
        terminal, damage: its port, and what happens to the bytes on their way.
        cut: whether its cable is pulled.
    """

    def __init__(self, name: str, terminal: Port, wire: Wire, damage: Damage) -> None:
        self.name, self.terminal, self.wire, self.damage = name, terminal, wire, damage
        self.cut = False

    @property
    def due(self) -> float:
        """Time at which `deliver` has something to do [s]; infinite where nothing is on its way."""
        return math.inf if self.wire.due is None else self.wire.due

    @abstractmethod
    def act(self, faults: Sequence[Fault]) -> None:
        """These faults act from now on, and no others."""

    @abstractmethod
    def receive(self, now: float) -> None:
        """Take what the host sent, and prepare the answers."""

    def deliver(self, now: float) -> None:
        """Give the host what has come over the wire by now."""
        data = self.wire.take(now)
        if data and not self.cut:
            self.terminal.write(data)

    def watch(self, now: float) -> None:  # noqa: B027 - not everything watches over itself
        """Let what happens by itself happen; called as time passes."""

    def report(self, elapsed: float) -> dict[str, Any]:
        """Figures of what happened in `elapsed` [s]."""
        spoilt = {str(kind): count for kind, count in self.damage.spoilt.items() if count}
        return {"wire_busy_share": round(self.wire.busy_s / elapsed, 4), "spoilt": spoilt}


@dataclass(frozen=True)
class _Sent:
    """What the host sent at once.

    Attributes:
        ready: time at which the devices are to work on it; `end` when its last byte is over [s].
        data: what is left of it; `baud` its bit rate.
    """

    ready: float
    end: float
    data: bytes
    baud: int


class BusLine(Line):
    """A bus of servos on its wire, half duplex.

    Goals for many act when their last byte is over. What may be answered is worked out at once, while it is on the
    wire: a computer takes longer for it than servos do.

    Attributes:
        bus: its devices.
    """

    def __init__(self, name: str, bus: EmulatedBus, terminal: Port, wire: Wire, damage: Damage) -> None:
        super().__init__(name, terminal, wire, damage)
        self.bus = bus
        self._last_received = 0.0
        self._incomplete = False
        self._arriving: deque[_Sent] = deque()

    @property
    def due(self) -> float:
        """See `Line`."""
        return min(super().due, self._arriving[0].ready if self._arriving else math.inf)

    def act(self, faults: Sequence[Fault]) -> None:
        """See `Line`."""
        kinds = {fault.kind for fault in faults}
        self.damage.act(faults)
        self.cut = FaultKind.CABLE in kinds
        self.bus.dead = {int(fault.argument) for fault in faults if fault.kind is FaultKind.DEAD}
        if FaultKind.IMU in kinds:
            self.bus.dead |= self.bus.imu_ids
        if FaultKind.PORT in kinds:
            self.wire.clear()
            self._arriving.clear()
            self.terminal.close()

    def receive(self, now: float) -> None:
        """See `Line`."""
        data = self.terminal.read()
        if self._incomplete and now - self._last_received > SILENCE_S:
            self.bus.drop_incomplete()
        self._last_received = now
        if data and not self.cut:
            baud = self.terminal.baud or 1
            end = self.wire.send(len(data), baud, now)
            self._arriving.append(
                _Sent(now if self.bus.may_be_answered(data) else end, end, self.damage.spoil(data)[0], baud)
            )

    def deliver(self, now: float) -> None:
        """See `Line`; and let the devices hear what has reached them by now."""
        while self._arriving and self._arriving[0].ready <= now:
            self._take(self._arriving.popleft())
        super().deliver(now)

    def watch(self, now: float) -> None:
        """See `Line`."""
        self.bus.watch(now)

    def _take(self, sent: _Sent) -> None:
        packets = self.bus.receive(sent.data, sent.baud, sent.end)
        after = sum(size for size, _ in packets)
        self._incomplete = after < len(sent.data)
        for size, replies in packets:
            after -= size
            if replies:
                asked = sent.end - self.wire.seconds(after, sent.baud)
                self.wire.answer([(reply, *self.damage.spoil(reply.data)) for reply in replies], sent.baud, asked)

    def report(self, elapsed: float) -> dict[str, Any]:
        """See `Line`."""
        counts = {"packets": self.bus.received, "bad_packets": self.bus.bad, "collisions": self.wire.collisions}
        return counts | super().report(elapsed)
