"""The DYNAMIXEL SDK over a `SerialPort`, for everything outside the control cycle.

The SDK's own port polls without sleeping, measures with the wall clock and assumes a latency timer of 16 ms for every
adapter: `SdkPort` sleeps until bytes arrive, on the monotonic clock. The packets of the control cycle are handled by
`flexmotion.drivers.dynamixel.exchange`, because the SDK drops the error byte of every servo in a fast sync read.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from dynamixel_sdk import COMM_RX_CORRUPT, COMM_SUCCESS, PacketHandler, PortHandler

from flexmotion.configs.errors import DriverError
from flexmotion.drivers.bus.attempts import DAMAGED, PATIENCE_S, attempts
from flexmotion.drivers.dynamixel.packet import ALERT, Error
from flexmotion.drivers.dynamixel.registers import Register
from flexmotion.drivers.port import SerialPort

LATENCY_S = 0.025
"""Time that an answer may take in addition to its time on the wire [s]."""


class SdkPort(PortHandler):
    """An open `SerialPort` with the interface of the SDK's ports."""

    def __init__(self, line: SerialPort) -> None:
        super().__init__(line.path)
        self.line = line
        self.is_open = True
        self._deadline = 0.0
        self._unread = b""

    def getBaudRate(self) -> int:  # noqa: N802 - the SDK's name, as all below
        """Bit rate."""
        return self.line.baud

    def clearPort(self) -> None:  # noqa: N802
        """Discard received bytes."""
        self.line.receive()
        self._unread = b""

    def writePort(self, packet: Any) -> int:  # noqa: N802
        """Send a packet; the number of bytes sent."""
        self.line.send(bytes(packet))
        return 0 if self.line.lost else len(packet)

    def readPort(self, length: int) -> bytes:  # noqa: N802
        """At most `length` bytes; sleeps until some arrive or the packet times out."""
        if not self._unread:
            self._unread = self.line.wait(self._deadline - self.line.now())
        taken, self._unread = self._unread[:length], self._unread[length:]
        return taken

    def setPacketTimeout(self, packet_length: int) -> None:  # noqa: N802
        """Start the timeout of a packet of this many bytes."""
        self._deadline = self.line.now() + self.line.seconds(packet_length) + LATENCY_S

    def setPacketTimeoutMillis(self, msec: float) -> None:  # noqa: N802
        """Start a timeout [ms]."""
        self._deadline = self.line.now() + msec * 1e-3

    def isPacketTimeout(self) -> bool:  # noqa: N802
        """Whether the packet has timed out."""
        return self.line.lost is not None or (not self._unread and self.line.now() > self._deadline)


class Client:
    """Requests to single servos, with retries: finds, checks and configures them.

    Methods raise `DriverError`, which names id and port, if a servo does not answer or refuses.

    Attributes:
        damaged: whether something came in answer to the last request, but no intact answer.
    """

    def __init__(self, line: SerialPort) -> None:
        self.line, self.damaged = line, False
        self._port, self._handler = SdkPort(line), PacketHandler(2.0)

    def ping(self, id_: int, *, once: bool = False) -> int | None:
        """Model number of a device; None if it does not answer (`once`: one attempt)."""
        self.damaged = False
        for tried, _ in enumerate(attempts(self.line, once=once)):
            model, result, _ = self._handler.ping(self._port, id_)
            if result == COMM_SUCCESS:
                self.damaged = False
                self._drain(tried)
                return int(model)
            self.damaged |= result == COMM_RX_CORRUPT
        return None

    def find(self) -> dict[int, tuple[int, int]]:
        """Model number and firmware version of every device that answers a broadcast ping at this baud rate, by id."""
        found, result = self._handler.broadcastPing(self._port)
        return {id_: (model, firmware) for id_, (model, firmware) in found.items()} if result == COMM_SUCCESS else {}

    def read_block(self, id_: int, address: int, size: int, *, once: bool = False) -> bytes:
        """Read `size` bytes from `address` on (`once`: one attempt)."""

        def attempt() -> tuple[bytes, int, int]:
            data, result, error = self._handler.readTxRx(self._port, id_, address, size)
            # The SDK takes every status packet of the servo for the answer.
            short = result == COMM_SUCCESS and not error & ~ALERT and len(data) != size
            return bytes(data), COMM_RX_CORRUPT if short else result, error

        return bytes(self._try(id_, f"read of {address}", attempt, once=once))

    def read(self, id_: int, register: Register) -> int:
        """Read a register."""
        return register.unpack(self.read_block(id_, register.address, register.size))

    def write(self, id_: int, register: Register, value: int) -> None:
        """Write a register."""
        self.write_block(id_, register.address, register.pack(value))

    def write_block(self, id_: int, address: int, data: bytes) -> None:
        """Write bytes from `address` on."""

        def attempt() -> tuple[None, int, int]:
            result, error = self._handler.writeTxRx(self._port, id_, address, len(data), list(data))
            return None, result, error

        self._try(id_, f"write to {address}", attempt)

    def reboot(self, id_: int) -> None:
        """Restart a servo: torque goes off, hardware errors are cleared."""

        def attempt() -> tuple[None, int, int]:
            result, error = self._handler.reboot(self._port, id_)
            return None, result, error

        self._try(id_, "reboot", attempt)

    def _try(self, id_: int, what: str, attempt: Callable[[], tuple[Any, int, int]], *, once: bool = False) -> Any:
        self.damaged = False
        for tried, _ in enumerate(attempts(self.line, once=once)):
            answer, result, error = attempt()
            # A servo reports a CRC error if it received a broken packet: try again.
            if result == COMM_SUCCESS and error & ~ALERT != Error.CRC:
                self.damaged = False
                self._drain(tried)
                break
            self.damaged |= result == COMM_RX_CORRUPT
        else:
            told = DAMAGED if self.damaged else self._handler.getTxRxResult(result).removeprefix("[TxRxResult] ")
            reason = self.line.lost or told
            raise DriverError(f"port {self.line.path}: id {id_}: {what}: {reason}")
        if error & ~ALERT:
            code = error & ~ALERT
            name = Error(code).name.lower() if code in set(Error) else f"0x{code:02x}"
            raise DriverError(f"port {self.line.path}: id {id_}: {what} refused: {name} error")
        return answer

    def _drain(self, tried: int) -> None:
        """After repeated attempts, discard late answers: the next request must not take them for its own."""
        end = self.line.now() + PATIENCE_S
        while tried and self.line.lost is None and (left := end - self.line.now()) > 0:
            self.line.wait(left)
