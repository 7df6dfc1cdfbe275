"""`SerialPort`: a serial device, used exclusively, without waiting and, once open, without exceptions."""

from __future__ import annotations

import errno
import logging
import os
import select
import termios
import time
from collections.abc import Sequence
from pathlib import Path

import serial

from flexmotion.configs.errors import DriverError

BITS_A_BYTE = 10
"""Start bit, eight bits, stop bit."""

NETWORK = Path("/sys/class/net")
"""Where Linux lists its network interfaces, including CAN buses."""

FULL_S = 0.002
"""Time beyond that on the wire after which an adapter that takes no bytes has lost them [s]."""

ECHO_S = 0.02
"""Time within which an echo comes back [s]."""
_NO_PACKET = bytes(2)

_CHUNK = 4096

log = logging.getLogger(__name__)


class SerialPort:
    """An open port. Once it is open, only `set_baud` raises: a port that fails is `lost` from then on.

    Args:
        path: the device.
        baud: bit rate.

    Attributes:
        path, baud: as given.
        lost: why the port is gone; None while it works.
        sent: bytes sent so far.
        busy_until: time at which the last byte sent has left the wire [s].
        descriptor: file descriptor.
    """

    def __init__(self, path: str, baud: int) -> None:
        """Raises `DriverError` if the device is missing, in use, or does not support the baud rate."""
        self.path, self.baud = path, baud
        self.lost: str | None = None
        self.sent, self.busy_until = 0, 0.0
        self._silent = False  # the last `receive` found nothing
        try:
            self._serial = serial.Serial(path, baud, timeout=0, write_timeout=0, exclusive=True)
        except serial.SerialException as error:
            raise DriverError(f"port {path}: {_reason(path, error)}") from error
        except ValueError as error:
            raise DriverError(f"port {path}: cannot run at {baud} baud: {error}") from error
        try:
            # Otherwise an FTDI adapter buffers bytes for 16 ms.
            self._serial.set_low_latency_mode(True)
        except (OSError, ValueError, NotImplementedError, AttributeError):
            log.debug("port %s has no low-latency mode", path)
        self.descriptor = int(self._serial.fileno())

    def seconds(self, size: int) -> float:
        """Time that `size` bytes take on the wire [s]."""
        return size * BITS_A_BYTE / self.baud

    def send(self, data: bytes) -> None:
        """Pass bytes to the adapter, which sends them when the wire is free.

        An adapter whose buffer is full takes a part of them; the rest follows while that part is sent.
        """
        if self.lost is not None:
            return
        left, end = data, 0.0
        for _ in range(2 * len(data)):
            try:
                # Not through pyserial, which copies and selects first.
                left = left[os.write(self.descriptor, left) :]
                if not left:
                    break
            except BlockingIOError:
                end = end or time.perf_counter() + self.seconds(len(data)) + FULL_S
                if not select.select((), (self.descriptor,), (), max(end - time.perf_counter(), 0.0))[1]:
                    break
            except OSError as error:
                self._lose(error)
                return
        if left:
            log.warning("port %s: the adapter takes no more: %d of %d bytes are lost", self.path, len(left), len(data))
        self._count(data)

    def echoes(self) -> bool:
        """Whether the adapter returns what is sent. Sends bytes that are no packet of any protocol, and waits."""
        self.receive()
        self.send(_NO_PACKET)
        end, came = self.busy_until + ECHO_S, b""
        while (left := end - self.now()) > 0 and self.lost is None and len(came) < len(_NO_PACKET):
            came += self.wait(left)
        return came == _NO_PACKET

    def refuse_echo(self) -> None:
        """Raise `DriverError` if the adapter returns what is sent, and close the port."""
        if self.echoes():
            self.close()
            raise DriverError(
                f"port {self.path}: the adapter echoes what is sent, and answers cannot be told from it: switch the "
                "echo off (its receiver must be disabled while it sends), or use another adapter"
            )

    def receive(self) -> bytes:
        """Bytes that have arrived, without waiting."""
        if self.lost is not None:
            return b""
        try:
            # Not through pyserial, which selects first.
            data = os.read(self.descriptor, _CHUNK)
            if not data and self._silent:
                # A device that is gone is silent too, but `select` has something to read from it.
                _ = self._serial.in_waiting  # raises if the device is gone
        except OSError as error:
            self._lose(error)
            return b""
        self._silent = not data
        return data

    def wait(self, seconds: float) -> bytes:
        """Bytes that have arrived, after waiting at most `seconds` for the first."""
        self.wait_any([self], seconds)
        return self.receive()

    def wait_any(self, ports: Sequence[SerialPort], seconds: float) -> None:
        """Sleep until one of `ports` has bytes, at most `seconds`. All must be of this port's class."""
        descriptors = [port.descriptor for port in ports if port.lost is None]
        if descriptors:
            select.select(descriptors, (), (), max(seconds, 0.0))
        else:
            self.sleep(seconds)

    def now(self) -> float:
        """Time on the clock of this port [s]."""
        return time.perf_counter()

    def sleep(self, seconds: float) -> None:
        """Let time pass on the clock of this port."""
        time.sleep(max(seconds, 0.0))

    def set_baud(self, baud: int) -> None:
        """Change the bit rate. Raises `DriverError` if the port does not support it."""
        try:
            self._serial.baudrate = baud
        except (ValueError, OSError) as error:
            raise DriverError(f"port {self.path}: cannot run at {baud} baud: {error}") from error
        self.baud = baud

    def close(self) -> None:
        """Release the device. May be called twice."""
        self.lost = self.lost or "closed"
        try:
            self._serial.close()
        except OSError as error:
            log.debug("port %s: %s", self.path, error)

    def _count(self, data: bytes) -> None:
        self.sent += len(data)
        self.busy_until = max(self.busy_until, self.now()) + self.seconds(len(data))

    def _lose(self, error: Exception) -> None:
        self.lost = str(error) or type(error).__name__
        log.error("port %s is lost: %s", self.path, self.lost)


def _reason(path: str, error: serial.SerialException) -> str:
    if error.errno == errno.ENOENT and path and (NETWORK / path).is_dir():
        return "is a CAN or network interface, not a serial port: it needs a driver plug-in"
    if error.errno == errno.ENOENT:
        return "there is no such device"
    if error.errno == errno.EACCES:
        return "permission denied; on most systems members of group dialout may use it"
    if error.errno in (errno.EBUSY, errno.EAGAIN) or "exclusively lock" in str(error):
        return "another program holds it"
    if error.errno == errno.EISDIR or isinstance(error.__context__, termios.error):
        return "is not a serial port"
    return " ".join(str(error).split())
