"""`Line`: the devices on one emulated port, with wire time and faults. `BusLine`: a servo bus."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections import Counter, deque
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Protocol

from flexmotion.drivers.emulator.faults import Damage, Fault, FaultKind
from flexmotion.drivers.emulator.wire import Reply, Wire

SILENCE_S = 0.02
"""Time without bytes after which an incomplete packet is discarded [s]."""


class EmulatedBus(Protocol):
    """Devices of one protocol that share a wire.

    Attributes:
        dead: ids of devices that neither receive nor answer.
        received: number of intact packets from the host.
        imu_ids: ids of inertial sensors.
    """

    dead: set[int]
    received: int
    imu_ids: frozenset[int]

    @property
    def bad(self) -> int:
        """Number of broken packets from the host."""

    @property
    def refusals(self) -> Counter[str]:
        """Number of refusals of all servos by the name of their rule (`rules.yaml`)."""

    def may_be_answered(self, data: bytes) -> bool:
        """Whether bytes from the host may need an answer; False only if they certainly do not."""

    def receive(self, data: bytes, baud: int, now: float) -> list[tuple[int, list[Reply]]]:
        """Take bytes from the host at `baud`; for every packet in them, its size in bytes and the answers to it."""

    def drop_incomplete(self) -> None:
        """Discard an incomplete packet."""

    def watch(self, now: float) -> None:
        """Update hardware errors and watchdogs; called every `WATCH_S`."""

    def reset(self, id_: int, now: float) -> None:
        """Interrupt the power of a servo."""

    def trip(self, id_: int) -> None:
        """Let the bus watchdog of a servo trip. Raises `ConfigError` if it has none."""


class Port(Protocol):
    """The emulator's end of a serial port.

    Attributes:
        path: that the client opens.
        open: whether the port still exists.
        descriptor: file descriptor for `select`; -1: none.
    """

    path: str
    open: bool
    descriptor: int

    @property
    def baud(self) -> int:
        """Bit rate set by the client."""

    def read(self) -> bytes:
        """Bytes written by the client since the last call."""

    def write(self, data: bytes) -> None:
        """Send bytes to the client."""

    def close(self) -> None:
        """Remove the port, also for its client."""


class Line(ABC):
    """The devices on one emulated port.

    Attributes:
        name: of the port.
        terminal, wire, damage: the port, its wire time, and damage of packets.
        cut: whether the cable is pulled.
    """

    def __init__(self, name: str, terminal: Port, wire: Wire, damage: Damage) -> None:
        self.name, self.terminal, self.wire, self.damage = name, terminal, wire, damage
        self.cut = False

    @property
    def due(self) -> float:
        """Time of the next `deliver` [s]; infinite: no bytes are on the wire."""
        return math.inf if self.wire.due is None else self.wire.due

    @abstractmethod
    def act(self, faults: Sequence[Fault]) -> None:
        """Set the active faults."""

    @abstractmethod
    def receive(self, now: float) -> None:
        """Take the bytes that the host has sent, and prepare the answers."""

    def deliver(self, now: float) -> None:
        """Send the host the bytes that have left the wire by `now` [s]."""
        data = self.wire.take(now)
        if data and not self.cut:
            self.terminal.write(data)

    def watch(self, now: float) -> None:  # noqa: B027 - optional
        """Update devices; called every `WATCH_S`."""

    def report(self, elapsed: float) -> dict[str, Any]:
        """Figures of a run of `elapsed` [s]."""
        spoilt = {str(kind): count for kind, count in self.damage.spoilt.items() if count}
        return {"wire_busy_share": round(self.wire.busy_s / elapsed, 4), "spoilt": spoilt}


@dataclass(frozen=True)
class _Sent:
    """Bytes that the host sent at once.

    Attributes:
        ready: time at which the devices handle it [s].
        end: time at which its last byte has left the wire [s].
        data: after damage.
        baud: bit rate.
    """

    ready: float
    end: float
    data: bytes
    baud: int


class BusLine(Line):
    """A half-duplex servo bus.

    Sync and bulk writes act when their last byte has left the wire. Requests that may be answered are handled at once,
    while they are on the wire: the emulation of an answer takes longer than a servo does.

    Attributes:
        bus: its devices.
    """

    def __init__(self, name: str, bus: EmulatedBus, terminal: Port, wire: Wire, damage: Damage) -> None:
        super().__init__(name, terminal, wire, damage)
        self.bus = bus
        self._echo = False
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
        self._echo = FaultKind.ECHO in kinds
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
            if self._echo:
                self.wire.echo(data, end)
            self._arriving.append(
                _Sent(now if self.bus.may_be_answered(data) else end, end, self.damage.spoil(data)[0], baud)
            )

    def deliver(self, now: float) -> None:
        """See `Line`. Requests that are ready by `now` are handled."""
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
        counts: dict[str, Any] = {
            "packets": self.bus.received,
            "bad_packets": self.bus.bad,
            "collisions": self.wire.collisions,
            "refused": dict(self.bus.refusals),
        }
        return counts | super().report(elapsed)
