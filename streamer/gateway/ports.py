"""Ports of the gateway and of the stop process."""

from __future__ import annotations

import errno
import socket
from collections.abc import Iterator
from contextlib import contextmanager

from flexmotion.configs.errors import ConfigError

_BACKLOG = 64


@contextmanager
def bound(address: str, port: int) -> Iterator[socket.socket]:
    """A listening socket. Raises `OSError`."""
    family = socket.AF_INET6 if ":" in address else socket.AF_INET
    with socket.socket(family) as listening:
        listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        listening.bind((address, port))
        listening.listen(_BACKLOG)
        listening.setblocking(False)
        yield listening


def check_free(address: str, port: int, option: str) -> None:
    """Raise `ConfigError` where a port cannot be listened on."""
    try:
        with bound(address, port):
            pass
    except OSError as error:
        taken = "; does another run use it? give another port" if error.errno == errno.EADDRINUSE else ""
        raise ConfigError(
            f"{option}: {address}:{port} cannot be listened on: {error.strerror or error}{taken}"
        ) from error


def any_free(address: str = "127.0.0.1") -> int:
    """A port that is free now."""
    with bound(address, 0) as listening:
        return int(listening.getsockname()[1])
