"""`RequestChannel`: requests of an operator to a running loop, which takes them before its next tick."""

from __future__ import annotations

from enum import IntEnum
from threading import Lock
from typing import Any

import numpy as np

from flexmotion.drivers.realtime.ring import Reader, Ring
from flexmotion.records import Int, Record, column

_REASON_BYTES = 488


class Request(IntEnum):
    """What may be requested; see `flexmotion.streamer.control.ladder` for what each leads to.

    STOP, ESTOP, KILL, CLEAR: as the ladder defines them. ARM: torque on, stand up. DISARM: a balanced stop, parking,
    torque off. END: the same, and the end of the run. FAULT: an orderly end for the cause in `reason`. LOST: there is
    no planner; the plan that plays ends in its own stop, and `reason` is recorded as a fault. GIVEN_UP: the same, and
    there will be none: ARM is refused. LIMP, STIFF, REBOOT: torque or restart of the joints that `reason` names,
    separated by commas (`flexmotion.streamer.control.joint_torque`). GET_UP: a robot that lies without torque gets up;
    it clears the fault. WARNING, NOTE: `reason` is recorded. QUIT: the end at once; the driver is closed.
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
    ARM = 10
    DISARM = 11
    WARNING = 12
    GIVEN_UP = 13
    LIMP = 14
    STIFF = 15
    REBOOT = 16
    GET_UP = 17


OF_JOINTS = (Request.LIMP, Request.STIFF, Request.REBOOT)


class RequestRow(Record):
    """A request in shared memory."""

    request: Int = column("i8")
    reason: Any = column(f"S{_REASON_BYTES}")


class RequestChannel:
    """Requests of one sender. Each sender has a channel of its own, so that none waits for another."""

    def __init__(self) -> None:
        self._ring = Ring(RequestRow.dtype(), 32)
        self._row = RequestRow(np.zeros((), RequestRow.dtype()))
        self._sending = Lock()

    def send(self, request: Request, reason: str = "") -> None:
        """Publish a request; only one process may do so, from any thread. A reason longer than 488 bytes is cut."""
        with self._sending:
            self._row.request[...], self._row.reason[...] = request, reason.encode(errors="replace")[:_REASON_BYTES]
            self._ring.publish(np.asarray(self._row.array))

    def reader(self) -> RequestReader:
        """The loop's end."""
        return RequestReader(self._ring.reader())


class RequestReader:
    """Reads the requests of one channel."""

    def __init__(self, reader: Reader) -> None:
        self._reader = reader

    def read(self) -> list[tuple[Request, str]]:
        """Requests since the last call, in order, each with its reason."""
        return [
            (Request(int(row.request)), row.reason.item().decode(errors="replace"))
            for row in map(RequestRow, self._reader.read())
        ]
