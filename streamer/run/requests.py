"""`RequestChannel`: what an operator asks of a running loop, heard at its next tick."""

from __future__ import annotations

from enum import IntEnum

import numpy as np

from flexmotion.drivers.realtime.ring import Reader, Ring

_DTYPE = np.dtype([("request", "i8"), ("reason", "S488")])


class Request(IntEnum):
    """What may be asked; see `flexmotion.streamer.control.ladder` for what each leads to.

    STOP, ESTOP, KILL, CLEAR: as the ladder means them. END: a balanced stop, parking, the end of the run. FAULT: an
    orderly end because of what `reason` says. LOST: the planner is gone, what plays ends in its own stop; `reason`
    is kept as a fault. NOTE: `reason` is kept. QUIT: the end at once, the driver closed as it closes.
    """

    STOP = 1
    ESTOP = 2
    KILL = 3
    CLEAR = 4
    END = 5
    FAULT = 6
    LOST = 7
    QUIT = 8
    NOTE = 9


class RequestChannel:
    """Requests of one operator; an operator has its own, so that nobody waits for another."""

    def __init__(self) -> None:
        self._ring = Ring(_DTYPE, 32)
        self._row = np.zeros((), _DTYPE)

    def ask(self, request: Request, reason: str = "") -> None:
        """Ask for something, from the one process that owns this end."""
        self._row["request"], self._row["reason"] = request, reason.encode()[:488]
        self._ring.publish(self._row)

    def listener(self) -> Listener:
        """The loop's end."""
        return Listener(self._ring.reader())


class Listener:
    """Hears what was asked."""

    def __init__(self, reader: Reader) -> None:
        self._reader = reader

    def heard(self) -> list[tuple[Request, str]]:
        """Requests since the last call, in order."""
        return [(Request(int(row["request"])), row["reason"].decode(errors="replace")) for row in self._reader.read()]
