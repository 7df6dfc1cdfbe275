"""`attempts`: how often a request outside the control cycle is repeated before a servo counts as silent."""

from __future__ import annotations

from collections.abc import Iterator

from flexmotion.drivers.port import SerialPort

TRIES = 3
PATIENCE_S = 0.3
"""Longest time that a busy host (USB adapter, other processes) delays a reply [s]."""

DAMAGED = (
    "every answer comes damaged: perhaps two servos have this id (connect one of them alone and give it its own with "
    "`flexmotion servo set-id`), or the cable is bad"
)
"""Why a servo cannot be talked to that does answer."""


def attempts(port: SerialPort, *, once: bool = False) -> Iterator[None]:
    """Yield once per attempt: at least `TRIES` times, as often as fits `PATIENCE_S`, until the port is lost."""
    end = port.now() + PATIENCE_S
    tried = 0
    while tried == 0 or not (once or port.lost is not None or (tried >= TRIES and port.now() >= end)):
        yield
        tried += 1
