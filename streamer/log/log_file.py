"""`LogFile`: the file of a log; a full disk ends the log, not its writer."""

from __future__ import annotations

import os
from pathlib import Path
from typing import IO

from flexmotion.configs.errors import ConfigError
from flexmotion.streamer.log.lock import lock


class LogFile:
    """File object for the MCAP writer.

    After a failed write the file is cut back to the last `mark`, so that it stays readable, and later writes are
    dropped.

    It is locked while it is open, here or in a process that was forked meanwhile.

    Args:
        path: path of the file; an existing file is overwritten.

    Attributes:
        error: error of the failed write; None without one.

    Raises:
        ConfigError: the file cannot be written, or another run writes to it.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.error: OSError | None = None
        self._marked = 0
        try:
            descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o666)
            # Unbuffered: a write fails at once, and a fork holds no copy of a buffer.
            self._file = os.fdopen(descriptor, "r+b", buffering=0)
            lock(descriptor, path, "--log")
            os.ftruncate(descriptor, 0)
        except OSError as error:
            raise ConfigError(f"{path}: cannot be written ({error.strerror or error})") from error

    def write(self, content: bytes) -> int:
        """Write all of it, or drop it. Returns its length either way, so that the MCAP writer does not fail."""
        view = memoryview(content)
        try:
            while self.error is None and len(view):
                view = view[self._file.write(view) :]
        except OSError as error:
            self.error = error
            os.ftruncate(self._file.fileno(), self._marked)
        return len(content)

    def held(self) -> IO[bytes]:
        """A file object that keeps the lock until it is closed, also after `close`."""
        return os.fdopen(os.dup(self._file.fileno()), "rb", buffering=0)

    def mark(self) -> None:
        """Mark what has been written so far as complete."""
        if self.error is None:
            self._marked = self._file.tell()

    def seek(self, offset: int, whence: int = 0) -> int:
        """See `io.IOBase.seek`."""
        return self._file.seek(offset, whence)

    def tell(self) -> int:
        """See `io.IOBase.tell`."""
        return self._file.tell()

    def flush(self) -> None:
        """Do nothing: the file has no buffer."""

    def close(self) -> None:
        """See `io.IOBase.close`."""
        self._file.close()
