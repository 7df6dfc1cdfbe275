"""What the loop says, tick by tick, to whoever listens: rows and events, in rings that hold the last half minute."""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np

from flexmotion.drivers.realtime.ring import Reader, Ring
from flexmotion.streamer.control.tick_row import blank, tick_dtype

KEPT_S = 30.0
"""What the rings hold: long enough for a reader that was held up, and to tell what led to a fault [s]."""
_EVENTS = 512
_EVENT = np.dtype([("tick", "i8"), ("stamp_ns", "i8"), ("kind", "S16"), ("message", "S488")])


@dataclass(frozen=True)
class Event:
    """Something worth a line in the log: a change of state, a fault, a warning."""

    tick: int
    kind: str
    message: str


class Telemetry:
    """Written by the loop alone once it runs, before by who starts it; everybody else follows.

    Args:
        joints: number of joints.
        rate_hz: ticks a second.

    Attributes:
        row: this tick's row, filled in place, shape ().
        ticks, events: the rings.
    """

    def __init__(self, joints: int, rate_hz: float) -> None:
        dtype = tick_dtype(joints)
        self.row = blank(dtype)
        self._floats = [self.row[name] for name in dtype.names or () if dtype[name].base.kind == "f"]
        self.ticks = Ring(dtype, int(KEPT_S * rate_hz))
        self.events = Ring(_EVENT, _EVENTS)
        self._event = np.zeros((), _EVENT)

    def commit(self) -> None:
        """Publish the row; the next one begins with its counts and with no measurement."""
        self.ticks.publish(self.row)
        for values in self._floats:
            values.fill(np.nan)

    def tell(self, tick: int, kind: str, message: str) -> None:
        """Publish an event; a message longer than 488 bytes is cut."""
        event = self._event
        event["tick"], event["stamp_ns"] = tick, time.perf_counter_ns()
        event["kind"], event["message"] = kind.encode(), message.encode()[:488]
        self.events.publish(event)


def events(reader: Reader) -> list[Event]:
    """The events since the last call."""
    return [
        Event(int(row["tick"]), row["kind"].decode(), row["message"].decode(errors="replace")) for row in reader.read()
    ]
