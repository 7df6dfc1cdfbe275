"""Locks on what a run writes: two runs that write to one file or folder would destroy each other's."""

from __future__ import annotations

import errno
import fcntl
import logging
import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from flexmotion.configs.errors import ConfigError

_NO_LOCKS = (errno.ENOLCK, errno.ENOTSUP, errno.EOPNOTSUPP, errno.ENOSYS)
"""Errors of file systems without locks."""

log = logging.getLogger(__name__)


def lock(descriptor: int, path: Path, option: str) -> None:
    """Lock an open file or folder until it is closed here and in every process that is forked meanwhile (`flock`).

    Args:
        option: of the command line, for the message.

    Raises:
        ConfigError: another run has locked it.
    """
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError as error:
        raise ConfigError(
            f"{option}: {path}: a run that is not over yet writes to it; choose another path, or end that run"
        ) from error
    except OSError as error:
        if error.errno not in _NO_LOCKS:
            raise
        log.warning("%s: its file system has no locks: do not let another run write to it", path)


def refuse_locked(path: Path | None, option: str = "--log") -> None:
    """Raise `ConfigError` if another run writes to a file; None: no file.

    It is not locked here: who writes to it locks it once it is opened, which may be seconds later.
    """
    if path is None or not path.is_file():
        return
    descriptor = os.open(path, os.O_RDONLY | os.O_CLOEXEC)
    try:
        lock(descriptor, path, option)
    finally:
        os.close(descriptor)


@contextmanager
def locked_folder(folder: Path | None, option: str = "--report") -> Iterator[None]:
    """Context in which no other run writes to a folder, which is made where it is missing; None: no folder.

    A folder that was made and is still empty, as of a run that was refused, is removed again.

    Raises:
        ConfigError: another run has locked it.
    """
    if folder is None:
        yield
        return
    made = [path for path in (folder, *folder.parents) if not path.exists()]
    folder.mkdir(parents=True, exist_ok=True)
    descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
    try:
        lock(descriptor, folder, option)
        try:
            yield
        finally:
            with suppress(OSError):  # it is not empty
                for path in made:
                    path.rmdir()
    finally:
        os.close(descriptor)
