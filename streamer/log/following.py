"""`Following`: reads what a run publishes in shared memory, and passes it on as the messages of a log."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Protocol

from flexmotion.streamer.control.ladder import State
from flexmotion.streamer.control.plan_buffer import PlanBuffer
from flexmotion.streamer.control.telemetry import Telemetry
from flexmotion.streamer.log.cdr import ENCAPSULATION
from flexmotion.streamer.log.header import LogHeader
from flexmotion.streamer.log.messages import plan_message
from flexmotion.streamer.motion.heard import Heard, HeardChannel, heard_since
from flexmotion.streamer.motion.intents import to_content
from flexmotion.streamer.motion.person_channel import PersonChannel
from flexmotion.streamer.motion.targets import TargetMailbox, arrived

_MOST_ROWS = 250
"""Ticks passed on at a time; the ring holds many more."""


@dataclass(frozen=True)
class Published:
    """What a run publishes.

    Attributes:
        begun: gives the header of the run once it has begun: whether the robot stays is known then.
        heard: the answers to what is asked in the run.
        items: the answers to the script or the prompt, known before.
        persons: poses of the person who is mirrored; None: nobody is.
    """

    begun: Callable[[], LogHeader]
    telemetry: Telemetry
    plans: PlanBuffer
    targets: TargetMailbox
    heard: HeardChannel
    items: Sequence[Heard] = ()
    persons: PersonChannel | None = None

    @cached_property
    def header(self) -> LogHeader:
        """See `begun`."""
        return self.begun()


class Sink(Protocol):
    """Takes messages with their log times [ns]."""

    def tick(self, message: bytes, time_ns: int) -> None:
        """The row of a tick, as CDR."""
        ...

    def plan(self, message: bytes, time_ns: int) -> None:
        """A plan, as CDR."""
        ...

    def person(self, message: bytes, time_ns: int) -> None:
        """A pose of the person who is mirrored, as CDR."""
        ...

    def target(self, content: dict[str, Any], time_ns: int) -> None:
        """A target."""
        ...

    def heard(self, content: dict[str, Any], time_ns: int) -> None:
        """An answer."""
        ...

    def event(self, content: dict[str, Any], time_ns: int) -> None:
        """An event."""
        ...


class Following:
    """Passes on what is new with every `step`.

    Args:
        published: by the run.
        sink: takes the messages.
        new_only: begin with what is published from now on, not with what is still kept.

    Attributes:
        moving: whether the last step found new ticks.
        tick, state: of the newest row that was passed on.
        passed, lost: ticks passed on, and ticks that were overwritten before they were read.
    """

    def __init__(self, published: Published, sink: Sink, *, new_only: bool = False) -> None:
        self.published, self.header, self.sink = published, published.header, sink
        self.moving = False
        self.tick = self.passed = self.lost = 0
        self.state = State.OFF
        self._plan = 0
        telemetry = published.telemetry
        self._ticks = telemetry.ticks.reader(new_only=new_only)
        self._events = telemetry.events.reader(new_only=new_only)
        self._targets, self._heard = published.targets.reader(), published.heard.reader()
        self._items = list(published.items)
        self._persons = None if published.persons is None else published.persons.reader(new_only=new_only)

    def step(self) -> None:
        """Pass on what is new since the last step."""
        self._pass_plan()
        self._pass_ticks()
        self._pass_persons()
        for target in arrived(self._targets):
            content = {"id": target.id, "stamp_ns": target.stamp_ns, **to_content(target.intent)}
            if math.isfinite(target.holds_s):
                content["holds_s"] = target.holds_s
            self.sink.target(content, self._time(self.tick, target.stamp_ns))
        self._items, heard = [], [*self._items, *heard_since(self._heard)]
        for answer in heard:
            stamp_ns = time.perf_counter_ns()
            content = {"stamp_ns": stamp_ns, **answer.model_dump(mode="json")}
            self.sink.heard(content, self._time(self.tick, stamp_ns))
        for row in self._events.read():
            message = row["message"].decode(errors="replace")
            self.event(int(row["tick"]), int(row["stamp_ns"]), row["kind"].decode(), message)

    def event(self, tick: int, stamp_ns: int, kind: str, message: str) -> None:
        """Pass on an event."""
        content: dict[str, Any] = {"tick": tick, "stamp_ns": stamp_ns, "kind": kind, "message": message}
        self.sink.event(content, self._time(tick, stamp_ns))

    def _pass_ticks(self) -> None:
        first = self._ticks.lost
        self.moving = False
        while len(rows := self._ticks.read(_MOST_ROWS)):
            self.moving = True
            for row in rows:
                self.tick = int(row["tick"])
                message = ENCAPSULATION + row.tobytes()
                self.sink.tick(message, self._time(self.tick, int(row["stamp_ns"])))
            self.state = State(int(rows["state"][-1]))
            self.passed += len(rows)
        if self._ticks.lost > first:
            self.lost = self._ticks.lost
            note = f"recorder: {self.lost - first} ticks were overwritten before they were read"
            self.event(self.tick, time.perf_counter_ns(), "note", note)

    def _pass_persons(self) -> None:
        if self._persons is None:
            return
        for row in self._persons.read():
            stamp_ns = round(float(row["arrived_s"]) * 1e9)
            self.sink.person(ENCAPSULATION + row.tobytes(), self._time(self.tick, stamp_ns))

    def _pass_plan(self) -> None:
        offer = self.published.plans.observe(self._plan)
        if offer is not None:
            self._plan = offer.ticket.id
            self.sink.plan(plan_message(offer), self._time(offer.ticket.asked_tick, time.perf_counter_ns()))

    def _time(self, tick: int, stamp_ns: int) -> int:
        """Log time [ns]: the wall clock; in lockstep the time of the tick at the robot's rate."""
        if self.header.clock == "lockstep":
            return self.header.start_ns + round(tick * 1e9 / self.header.rate_hz)
        return stamp_ns + self.header.wall_minus_perf_ns
