"""`attempts`: how long a servo is asked again before it counts as silent, when not every tick asks."""

from __future__ import annotations

from collections.abc import Iterator

from flexmotion.drivers.port import SerialPort

TRIES = 3
PATIENCE_S = 0.3
"""As long as a busy host may keep a reply from the program: USB adapters, other processes [s]."""


def attempts(port: SerialPort, *, once: bool = False) -> Iterator[None]:
    """Turns of asking: at least `TRIES`, as many as fit `PATIENCE_S`, and none any more once the port is lost."""
    end = port.now() + PATIENCE_S
    tried = 0
    while tried == 0 or not (once or port.lost is not None or (tried >= TRIES and port.now() >= end)):
        yield
        tried += 1
