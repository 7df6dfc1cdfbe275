"""`Terminal`: a pseudo-terminal that looks like a serial port to whoever opens its other end."""

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
"""Linux `struct termios2`: flags, line discipline and control characters, input and output speed."""

_CHUNK = 4096


class Terminal:
    """A raw pseudo-terminal; it stays open while clients come and go.

    Args:
        link: where a symbolic link to the client's end is made; it disappears on `close`.

    Attributes:
        path: what the client opens: the link where there is one, else the device.
        descriptor: our end, non-blocking.
    """

    def __init__(self, link: Path | None = None) -> None:
        """Raises `ConfigError` where `link` exists and leads anywhere, or cannot be made."""
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
                link.unlink(missing_ok=True)  # what is left of an emulator that was killed
                link.symlink_to(self._device)
            except OSError as error:
                self.close()
                raise ConfigError(f"port link {link}: cannot be made ({error.strerror})") from error

    @property
    def baud(self) -> int:
        """Bit rate that the client has set."""
        answer = fcntl.ioctl(self.descriptor, _TCGETS2, bytes(_TERMIOS2.size))
        return int(_TERMIOS2.unpack(answer)[-1])

    def read(self) -> bytes:
        """What the client wrote since the last call."""
        try:
            return os.read(self.descriptor, _CHUNK)
        except BlockingIOError:
            return b""

    def write(self, data: bytes) -> None:
        """Give bytes to the client; what it leaves unread for too long is lost, as in an adapter's buffer."""
        try:
            os.write(self.descriptor, data)
        except OSError as error:
            if error.errno != errno.EAGAIN:
                raise

    def close(self) -> None:
        """The port is gone, for its client too. May be called twice."""
        if not self.open:
            return
        self.open = False
        os.close(self.descriptor)
        os.close(self._client)
        if self._link is not None and self._link.is_symlink() and os.readlink(self._link) == self._device:
            self._link.unlink()
