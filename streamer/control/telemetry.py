"""`Telemetry`: the loop's rows and events, published in rings that hold the last half minute."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexmotion.drivers.realtime.ring import Reader, Ring
from flexmotion.records import Float, Int, Record, column
from flexmotion.streamer.control.tick_row import TickRow, blank

KEPT_S = 30.0
"""What the rings hold: enough for a reader that was delayed, and to record what led to a fault [s]."""
_EVENTS = 512
_MESSAGE_BYTES = 488


class EventRow(Record):
    """An event in shared memory."""

    tick: Int = column("i8")
    stamp_ns: Int = column("i8")
    """`time.perf_counter_ns` at which it was emitted."""
    kind: Any = column("S16")
    message: Any = column(f"S{_MESSAGE_BYTES}")


@dataclass(frozen=True)
class Event:
    """A line of the log: a change of state, a fault, a warning."""

    tick: int
    kind: str
    message: str


class Telemetry:
    """One process writes it: the one that starts the run, and from the first tick on the loop. Any number read.

    Args:
        joints: number of joints.
        rate_hz: ticks a second.

    Attributes:
        row: this tick's row, filled in place.
        ticks, events: the rings, of `TickRow` and `EventRow`.
    """

    def __init__(self, joints: int, rate_hz: float) -> None:
        dtype = TickRow.dtype(joints=joints)
        self._row = blank(dtype)
        # A view of each field, made once: to look a field up in a structured row takes longer than to write it.
        self.row = TickRow({name: self._row[name] for name in TickRow.names()})
        self._floats = _runs_of_floats(self._row)
        self.ticks = Ring(dtype, int(KEPT_S * rate_hz))
        self.events = Ring(EventRow.dtype(), _EVENTS)
        self._event = EventRow(np.zeros((), EventRow.dtype()))

    def commit(self) -> None:
        """Publish the row; the next one begins with its counts and with no measurement."""
        self.ticks.publish(self._row)
        for values in self._floats:
            values.fill(np.nan)

    def emit(self, tick: int, kind: str, message: str) -> None:
        """Publish an event; a message longer than 488 bytes is cut."""
        event = self._event
        event.tick[...], event.stamp_ns[...] = tick, time.perf_counter_ns()
        event.kind[...], event.message[...] = kind.encode(), message.encode()[:_MESSAGE_BYTES]
        self.events.publish(np.asarray(event.array))


def _runs_of_floats(row: NDArray[np.void]) -> list[Float]:
    """Views of the floats of a row, one of each run of bytes in which fields of floats follow each other."""
    fields = [row.dtype.fields[name] for name in row.dtype.names or ()] if row.dtype.fields else []
    places = sorted((offset, offset + kind.itemsize) for kind, offset, *_ in fields if kind.base.kind == "f")
    runs: list[list[int]] = []
    for begin, end in places:
        if runs and runs[-1][1] == begin:
            runs[-1][1] = end
        else:
            runs.append([begin, end])
    raw = row.reshape(1).view(np.uint8)
    return [raw[begin:end].view(np.float64) for begin, end in runs]


def events(reader: Reader) -> list[Event]:
    """The events since the last call."""
    return [
        Event(int(row.tick), row.kind.item().decode(), row.message.item().decode(errors="replace"))
        for row in map(EventRow, reader.read())
    ]
