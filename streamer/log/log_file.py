"""`LogFile`: the file of a log; a full disk ends the log, not its writer."""

from __future__ import annotations

import os
from pathlib import Path

from flexmotion.configs.errors import ConfigError


class LogFile:
    """File object for the MCAP writer.

    After a failed write the file is cut back to the last `mark`, so that it stays readable, and later writes are
    dropped.

    Args:
        path: path of the file; an existing file is overwritten.

    Attributes:
        error: error of the failed write; None without one.

    Raises:
        ConfigError: the file cannot be written.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.error: OSError | None = None
        self._marked = 0
        try:
            # Unbuffered: a write fails at once, and a fork holds no copy of a buffer.
            self._file = open(path, "wb", buffering=0)  # noqa: SIM115 (closed by `close`)
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
