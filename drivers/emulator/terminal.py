"""`Terminal`: a pseudo-terminal that a client opens like a serial port."""

from __future__ import annotations

import errno
import fcntl
import os
import struct
import tty
from pathlib import Path

from flexmotion.configs.errors import ConfigError

_TCGETS2 = 0x802C542A
_TERMIOS2 = struct.Struct("4I20B2I")
"""Linux `struct termios2`: flags, line discipline, control characters, input and output speed."""

_CHUNK = 4096


class Terminal:
    """A raw pseudo-terminal; it stays open when a client closes it.

    Args:
        link: path of a symbolic link to the client's end, removed by `close`.

    Attributes:
        path: that the client opens: the link if there is one, else the device.
        descriptor: the emulator's end, non-blocking.
    """

    def __init__(self, link: Path | None = None) -> None:
        """Raises `ConfigError` if `link` exists and has a target, or cannot be created."""
        if link is not None and link.exists():
            raise ConfigError(f"port link {link}: exists already, expected a path that does not")
        self.descriptor, self._client = os.openpty()
        tty.setraw(self._client)
        os.set_blocking(self.descriptor, False)
        self._device = os.ttyname(self._client)
        self.path = self._device if link is None else str(link)
        self._link = link
        self.open = True
        if link is not None:
            try:
                link.unlink(missing_ok=True)  # left by an emulator that was killed
                link.symlink_to(self._device)
            except OSError as error:
                self.close()
                raise ConfigError(f"port link {link}: cannot be created ({error.strerror})") from error

    @property
    def baud(self) -> int:
        """Bit rate set by the client."""
        answer = fcntl.ioctl(self.descriptor, _TCGETS2, bytes(_TERMIOS2.size))
        return int(_TERMIOS2.unpack(answer)[-1])

    def read(self) -> bytes:
        """Bytes written by the client since the last call."""
        try:
            return os.read(self.descriptor, _CHUNK)
        except BlockingIOError:
            return b""

    def write(self, data: bytes) -> None:
        """Send bytes to the client; bytes that do not fit the buffer are lost, as in an adapter."""
        try:
            os.write(self.descriptor, data)
        except OSError as error:
            if error.errno != errno.EAGAIN:
                raise

    def close(self) -> None:
        """Remove the port, also for its client. May be called twice."""
        if not self.open:
            return
        self.open = False
        os.close(self.descriptor)
        os.close(self._client)
        if self._link is not None and self._link.is_symlink() and os.readlink(self._link) == self._device:
            self._link.unlink()
