"""`Loopback`: emulated buses in this process, on a simulated clock.

A driver exchanges bytes with them as over a real port, with the same wire time. The clock advances only while a port
waits, so that a run does not depend on the speed of the machine.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from flexmotion.configs.errors import DriverError
from flexmotion.drivers.emulator.body import Body
from flexmotion.drivers.emulator.build import assemble, port_names
from flexmotion.drivers.emulator.emulator import Emulator
from flexmotion.drivers.emulator.line import Line
from flexmotion.drivers.port import SerialPort

_GRAIN_S = 1e-9
"""Added to the end of a wait, so that rounding does not end it early [s]."""


class _Memory:
    """The emulator's end of a port in memory."""

    descriptor = -1

    def __init__(self, name: str) -> None:
        self.path, self.open, self.baud = name, True, 0
        self.to_bus, self.to_host = bytearray(), bytearray()

    def read(self) -> bytes:
        data = bytes(self.to_bus)
        self.to_bus.clear()
        return data

    def write(self, data: bytes) -> None:
        self.to_host += data

    def close(self) -> None:
        self.open = False


class Loopback:
    """Emulated buses of a body.

    Args:
        body: the body that servos move.
        arguments: of `flexmotion.drivers.emulator.build.assemble`.

    Attributes:
        emulator: of the buses.
        now: simulated time [s].
    """

    def __init__(self, body: Body, **arguments: Any) -> None:
        self.now = 0.0
        self._ports = {name: _Memory(name) for name in port_names(body.robot)}
        self.emulator: Emulator = assemble(body, self._ports, **arguments)

    def open_port(self, name: str, baud: int) -> LoopbackPort:
        """The port of that name, for `BusDriver.open_port`. Raises `DriverError` if there is none."""
        for line in self.emulator.lines:
            if line.name == name:
                return LoopbackPort(self, line, self._ports[name], baud)
        raise DriverError(f"port {name}: there is no such port, expected one of: {', '.join(self._ports)}")

    def advance(self, seconds: float, *, until: Sequence[_Memory] = ()) -> None:
        """Let time pass, at most until one of the ports in `until` has bytes for the host."""
        end = self.now + max(seconds, 0.0) + _GRAIN_S
        while not any(port.to_host for port in until):
            wake = self.emulator.poll(self.now)
            if any(port.to_host for port in until) or wake > end:
                break
            self.now = max(self.now, wake)
        else:
            return
        if not any(port.to_host for port in until):
            self.now = end


class LoopbackPort(SerialPort):
    """A `SerialPort` to an emulated bus in this process."""

    def __init__(self, world: Loopback, line: Line, memory: _Memory, baud: int) -> None:
        self.path, self.baud, self.lost, self.sent, self.busy_until = line.name, baud, None, 0, 0.0
        self._world, self._line, self._memory = world, line, memory
        memory.baud = baud
        memory.to_host.clear()

    def send(self, data: bytes) -> None:
        """See `SerialPort`."""
        if self._there():
            self._count(data)
            self._memory.to_bus += data
            self._line.receive(self._world.now)

    def receive(self) -> bytes:
        """See `SerialPort`."""
        if not self._there():
            return b""
        data = bytes(self._memory.to_host)
        self._memory.to_host.clear()
        return data

    def wait_any(self, ports: Sequence[SerialPort], seconds: float) -> None:
        """See `SerialPort`."""
        self._world.advance(seconds, until=[port._memory for port in ports if isinstance(port, LoopbackPort)])

    def now(self) -> float:
        """See `SerialPort`."""
        return self._world.now

    def sleep(self, seconds: float) -> None:
        """See `SerialPort`."""
        self._world.advance(seconds)

    def set_baud(self, baud: int) -> None:
        """See `SerialPort`."""
        self.baud = self._memory.baud = baud

    def close(self) -> None:
        """See `SerialPort`."""
        self.lost = self.lost or "closed"

    def _there(self) -> bool:
        if self.lost is None and not self._memory.open:
            self.lost = "unplugged"
        return self.lost is None
