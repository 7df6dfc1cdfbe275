"""`Line`: one emulated bus behind one pseudo-terminal: bytes in, wire time, faults, bytes out."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

from drivers.emulator.faults import Damage, Fault, FaultKind
from drivers.emulator.wire import Reply, Wire

SILENCE_S = 0.02
"""Bytes of a packet that is not complete are forgotten after this time without more [s]."""


class EmulatedBus(Protocol):
    """Devices of one protocol that share a wire.

    Attributes:
        dead: ids that hear and say nothing.
        heard: whole packets that came from the host.
    """

    dead: set[int]
    heard: int

    @property
    def bad(self) -> int:
        """Broken packets that came from the host."""

    def hear(self, data: bytes, baud: int, now: float) -> list[tuple[int, list[Reply]]]:
        """Bytes from the host at `baud`: for every packet in them, its size in bytes and the answers to it."""

    def silence(self) -> None:
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


class Line:
    """A bus on its wire.

    Attributes:
        name: of the bus in the robot file.
        bus, wire, terminal, damage: its parts.
        cut: whether its cable is pulled.
    """

    def __init__(self, name: str, bus: EmulatedBus, terminal: Port, wire: Wire, damage: Damage) -> None:
        self.name, self.bus, self.terminal, self.wire, self.damage = name, bus, terminal, wire, damage
        self.cut = False
        self._last_heard = 0.0
        self._incomplete = False

    def act(self, faults: Sequence[Fault]) -> None:
        """These faults act from now on, and no others."""
        self.damage.act(faults)
        self.cut = any(fault.kind is FaultKind.CABLE for fault in faults)
        self.bus.dead = {int(fault.argument) for fault in faults if fault.kind is FaultKind.DEAD}
        if any(fault.kind is FaultKind.PORT for fault in faults):
            self.wire.clear()
            self.terminal.close()

    def hear(self, now: float) -> None:
        """Take what the host sent, and prepare the answers."""
        data = self.terminal.read()
        if self._incomplete and now - self._last_heard > SILENCE_S:
            self.bus.silence()
        self._last_heard = now
        if not data or self.cut:
            return
        baud = self.terminal.baud or 1
        data, _ = self.damage.spoil(data)
        packets = self.bus.hear(data, baud, now)
        self._incomplete = sum(size for size, _ in packets) < len(data)
        for size, replies in packets:
            end = self.wire.send(size, baud, now)
            if replies:
                self.wire.answer([(reply, *self.damage.spoil(reply.data)) for reply in replies], baud, end)

    def deliver(self, now: float) -> None:
        """Give the host what has come over the wire by now."""
        data = self.wire.take(now)
        if data and not self.cut:
            self.terminal.write(data)
