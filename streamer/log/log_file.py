"""`LogFile`: the file under a log; a disk that is full ends the log, not who writes it."""

from __future__ import annotations

import os
from pathlib import Path

from flexmotion.configs.errors import ConfigError


class LogFile:
    """What the MCAP writer writes to.

    Once a write has failed the file is cut back to the last `mark` and everything that follows is dropped: what is in
    it stays readable.

    Args:
        path: where; an older file of that name is written over.

    Attributes:
        error: what went wrong, if anything did.

    Raises:
        ConfigError: the file cannot be written.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.error: OSError | None = None
        self._marked = 0
        try:
            # Unbuffered: a write that fails fails here, and whoever forks holds no copy of what waits to be written.
            self._file = open(path, "wb", buffering=0)  # noqa: SIM115 (closed by `close`)
        except OSError as error:
            raise ConfigError(f"{path}: cannot be written ({error.strerror or error})") from error

    def write(self, content: bytes) -> int:
        """Write all of it, or drop it. Returns its length either way: the MCAP writer must not stumble over a disk."""
        view = memoryview(content)
        try:
            while self.error is None and len(view):
                view = view[self._file.write(view) :]
        except OSError as error:
            self.error = error
            os.ftruncate(self._file.fileno(), self._marked)
        return len(content)

    def mark(self) -> None:
        """What has been written so far is whole."""
        if self.error is None:
            self._marked = self._file.tell()

    def seek(self, offset: int, whence: int = 0) -> int:
        """See `io.IOBase.seek`."""
        return self._file.seek(offset, whence)

    def tell(self) -> int:
        """See `io.IOBase.tell`."""
        return self._file.tell()

    def flush(self) -> None:
        """Nothing waits to be written."""

    def close(self) -> None:
        """See `io.IOBase.close`."""
        self._file.close()
