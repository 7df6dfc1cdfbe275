"""`Heard`: the answer to one thing that was asked: what it was taken for, what was slowed, dropped or refused, and why.

One record for all that tell it: report, log, events, the library and whatever carries targets over a network. The
planner's process writes it to `HeardChannel`, in shared memory; any process reads it there.
"""

from __future__ import annotations

import json
from collections.abc import Container, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict

from flexmotion.drivers.realtime.ring import Reader, Ring
from flexmotion.records import Int, Record, column
from flexmotion.spatial.heading import wrapped
from flexmotion.text.vocabulary import Quantity

State = Literal["accepted", "slowed", "moved", "partly", "refused", "superseded", "expired"]
"""accepted: as asked; slowed: to what the robot can follow; moved: to the nearest place in reach; partly:
without what `dropped` names; refused: not at all, for `reason`; superseded: another target came first; expired: it came
too late."""

End = Literal["done", "time limit", "superseded", "expired", "stopped"]
"""How a step ended: its amount was measured, or its time limit, another target, the end of the target's time to live or
a stop came first."""

Halt = Literal["expired", "stopped"]
"""Why nothing is followed any more: the target's time to live is over; a stop, a fault, or what the robot cannot do."""

Holds = Literal["part", "restriction"]
"""What holds beside what the whole body does: an arm, the head or a foot at a place of its own, or a restriction."""

Over = Literal["expired", "superseded", "let go", "stopped"]
"""How what held beside the whole body ended: its time is over, another target took its place, somebody let it go, or a
stop, a fault or a planner that was started again. A motion that a kept foot ended is "stopped"."""

GOALS = ("heading", "waypoint")
"""What is heard where the robot is to come to a heading or a place in its odometry."""

_BYTES, _HELD_BYTES = 8000, 64_000


class HeardStep(BaseModel):
    """One request of a sentence.

    Attributes:
        text: words that the listener heard.
        heard_as: kind of motion; None: not understood.
        manner: in which it is done; None: the normal one.
        beside: kind of the gesture that arms or head make meanwhile; None: there is none.
        certainty: share of that kind in what the listener heard, in [0, 1].
        amount: how much of it, in radians, metres, steps, seconds or times (`unit`); None: until the next target.
        limit_s: the step ends after this time, done or not [s]; None: never.
        slowed: speed that the motion is slowed to; None: not slowed.
        end: how it ended; None: not yet, or not measured.
        end_s: when it ended, by the robot's clock [s].
        measured: what the robot did of it by its own odometry, in `unit`; None at its end: it never began.
        place: of a heading or a waypoint: where the robot stood at the end by its odometry, x, y [m], heading [rad].
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    text: str
    heard_as: str | None = None
    manner: str | None = None
    beside: str | None = None
    certainty: float | None = None
    amount: float | None = None
    unit: Quantity | None = None
    limit_s: float | None = None
    slowed: str | None = None
    end: End | None = None
    end_s: float | None = None
    measured: float | None = None
    place: tuple[float, float, float] | None = None

    @property
    def motion(self) -> str:
        """Its kind of motion, with the gesture that is made meanwhile."""
        return str(self.heard_as) if self.beside is None else f"{self.heard_as} with {self.beside}"

    @property
    def is_measured(self) -> bool:
        """Whether its end is measured: it has an amount, a time limit, or a heading or a place to come to."""
        return self.amount is not None or self.limit_s is not None or self.heard_as in GOALS

    @property
    def fate(self) -> str:
        """What the robot did of it, and where it did not do it whole, why it ended."""
        if self.end in (None, "done"):
            return self.done
        limit = f" of {self.limit_s:.3g} s" if self.end == "time limit" and self.limit_s is not None else ""
        return f"{self.done} ({self.end}{limit})"

    @property
    def done(self) -> str:
        """What the robot did of the amount, or where it stands, in words."""
        if self.place is not None:
            x, y, heading = self.place
            degrees = np.degrees(wrapped(heading))
            return f"stands at {x:.2f} m ahead, {y:.2f} m left, heading {degrees:.0f}°"
        if self.amount is None or self.unit is None or self.measured is None:
            return "not begun" if self.end is not None and self.amount is not None else "not measured"
        measured = amount_text(self.measured, self.unit)
        if self.unit in ("steps", "times") and self.measured > self.amount:
            return f"{measured}, {self.amount:.3g} asked for"
        together = ", then feet together" if self.unit == "steps" and self.end == "done" else ""
        return f"{measured} of {amount_text(self.amount, self.unit)}{together}"


class Heard(BaseModel):
    """The answer to one target, or to one item of a script.

    Attributes:
        id: of the target; 0: of the script or the prompt.
        item: number of the script's item, from 0; None: of a target.
        at_s: when it was followed from, by the robot's clock; of an item its own time [s].
        tick: from which tick on it is followed; None: not yet, or of an item.
        asked: the words, or the velocity.
        state: what became of it.
        heard_as: kinds of motion, in the order in which they are done.
        manner: in which they are done, in the same order; None: in the normal one.
        certainty: the least of its steps' certainties, in [0, 1].
        slowed: speeds that it was slowed to; None: not slowed.
        moved: place, direction or angle that it was moved to; None: not moved.
        dropped: parts that are not done.
        reason: why it is refused, or stands still.
        notes: what was taken for words that say no number, and what else there is to know of how it is done.
        steps: its requests; empty where it is refused.
        left_s: the time that is left to the target whose speed it changes, and to it [s]; None: it has its own.
        holds: what holds from then on; None: it is for the whole body, or lets something go.
        there: of a part, once it is there: how far it is from its place as measured, in words.
        missed: of a part that was not there in time: likewise.
        over: how what held ended, or a motion that the restriction of a foot ended (`reason`: which); None: it goes on,
            ended in another way, or never began.
        reached: in a report, whether the run came to this item of its script.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    id: int = 0
    item: int | None = None
    at_s: float | None = None
    tick: int | None = None
    asked: str
    state: State
    heard_as: str | None = None
    manner: str | None = None
    certainty: float | None = None
    slowed: str | None = None
    moved: str | None = None
    dropped: tuple[str, ...] = ()
    reason: str | None = None
    notes: tuple[str, ...] = ()
    steps: tuple[HeardStep, ...] = ()
    left_s: float | None = None
    holds: Holds | None = None
    there: str | None = None
    missed: str | None = None
    over: Over | None = None
    reached: bool = True

    @property
    def held(self) -> bool:
        """Whether something holds: a target for a part or a restriction was followed, and has not ended."""
        followed = self.tick is not None and self.state not in ("refused", "superseded", "expired")
        return self.holds is not None and followed and self.over is None

    @property
    def failure(self) -> str | None:
        """What was asked and not done, in words; None: nothing."""
        if self.state == "refused":
            return f"refused: {self.told()}"
        if self.dropped:
            return f"{self.asked!r}: not done: {', '.join(self.dropped)}"
        late = [step.text for step in self.steps if step.end == "time limit"]
        return f"{self.asked!r}: not finished within its time: {', '.join(late)}" if late else None

    @property
    def cut(self) -> str | None:
        """What of a script's item or a prompt the end of the run cut off, in words; None: nothing.

        An operator's target is stopped on purpose.
        """
        if self.item is None or all(step.end != "stopped" for step in self.steps):
            return None
        done = ", ".join(f"{step.text}: {step.done}" for step in self.steps)
        return f"{self.asked!r}: not done whole when the run ended ({done})"

    def told(self) -> str | None:
        """A line for the operator; None where all is done exactly as asked."""
        if self.state == "refused":
            # The listener's reasons begin with the words as asked.
            whole = str(self.reason).startswith(repr(self.asked))
            refused = str(self.reason) if whole else f"{self._request} is refused: {self.reason}"
            return "; ".join((refused, *self.notes))
        parts = []
        if len(self.steps) > 1 or any(step.amount is not None for step in self.steps):
            parts.append("heard as " + ", then ".join(_step_text(step) for step in self.steps))
        elif self.manner is not None:
            parts.append(f"heard as {self.heard_as}, {self.manner}")
        if self.slowed is not None:
            parts.append(f"slowed to {self.slowed}")
        if self.moved is not None:
            parts.append(f"moved to {self.moved}")
        parts += [f"without {', '.join(map(repr, self.dropped))}"] if self.dropped else []
        parts += list(self.notes)
        return f"{self._request} is {'; '.join(parts)}" if parts else None

    @property
    def _request(self) -> str:
        return self.asked if str(self.heard_as).startswith("velocity") else repr(self.asked)


def _step_text(step: HeardStep) -> str:
    kind = f"{step.motion}, {step.manner}," if step.manner else step.motion
    if step.amount is None or step.unit is None:
        return kind.rstrip(",")
    limit = "" if step.limit_s is None else f" (at most {step.limit_s:.0f} s)"
    return f"{kind} {amount_text(step.amount, step.unit)}{limit}"


def amount_text(value: float, unit: Quantity) -> str:
    """An amount with its unit: "90°", "2 steps", "1.5 m"."""
    if unit == "angle":
        return f"{np.degrees(value):.0f}°"
    names = {"length": "m", "time": "s", "steps": "step", "times": "time"}
    return f"{value:.3g} {names[unit]}{'s' if unit in ('steps', 'times') and value != 1 else ''}"


class HeardRow(Record):
    """An answer in shared memory: JSON."""

    id: Int = column("i8")
    content: Any = column(f"S{_BYTES}")


class HeldRow(Record):
    """All that holds, in shared memory: JSON, a list of answers."""

    content: Any = column(f"S{_HELD_BYTES}")


@dataclass(frozen=True)
class _Answered(Container[int]):
    """Some numbers, and all below one."""

    known: set[int]
    below: int

    def __contains__(self, number: object) -> bool:
        return number in self.known or (isinstance(number, int) and number < self.below)


class HeardChannel:
    """Answers in shared memory. One process writes, the planner's; any number read. The newest of an id counts.

    Of what holds beside the whole body all answers stay readable (`held`), however many others come: a foot that is
    kept down for an hour is known to a planner that is started again, and to a gateway that begins later.
    """

    def __init__(self) -> None:
        self._ring, self._held = Ring(HeardRow.dtype(), 128), Ring(HeldRow.dtype(), 4)
        self._row = HeardRow(np.zeros((), HeardRow.dtype()))
        self._held_row = HeldRow(np.zeros((), HeldRow.dtype()))

    def publish(self, heard: Heard) -> None:
        """Publish an answer, or a later version of one: a step of it has ended."""
        content = _json(heard)
        if len(content) > _BYTES:
            # Only a sentence of very many steps is that long; its steps are left out, not cut off in the middle.
            content = _json(heard.model_copy(update={"steps": (), "dropped": heard.dropped[:8]}))
        if heard.holds is not None:
            self._hold(heard)  # before the answer: who has read that one knows what holds
        self._row.id[...], self._row.content[...] = heard.id, content
        self._ring.publish(np.asarray(self._row.array))

    @property
    def held(self) -> list[Heard]:
        """The newest versions of the answers to what holds now, in order of their ids."""
        row = self._held.latest()
        return [] if row is None else [Heard.model_validate(one) for one in json.loads(HeldRow(row).content.item())]

    @property
    def held_changes(self) -> int:
        """How often `held` has changed."""
        return self._held.count

    def _hold(self, heard: Heard) -> None:
        known = {one.id: one for one in self.held}
        known.pop(heard.id, None)
        if heard.held:
            known[heard.id] = heard
        content = [known[number].model_dump(exclude_defaults=True) for number in sorted(known)]
        while len(text := json.dumps(content).encode()) > _HELD_BYTES:
            content.pop(0)  # two hundred at once: the oldest is told no longer
        self._held_row.content[...] = text
        self._held.publish(np.asarray(self._held_row.array))

    def reader(self) -> Reader:
        """A reader of all of them, for `heard_since`."""
        return self._ring.reader()

    def answered(self) -> Container[int]:
        """The ids of the targets that have been answered.

        Answers come in no order of ids. Those that the ring has lost are the oldest, and so are the ids that are below
        all that it still knows: no target waits while as many answers come as the ring holds.
        """
        reader = self.reader()
        known = {heard.id for heard in heard_since(reader)}
        return _Answered(known, min(known) if reader.lost else 0)


def _json(heard: Heard) -> bytes:
    return json.dumps(heard.model_dump(exclude_defaults=True)).encode()


def heard_since(reader: Reader) -> list[Heard]:
    """The answers since the last call."""
    return [Heard.model_validate_json(HeardRow(row).content.item()) for row in reader.read()]


def not_done(answers: Sequence[Heard]) -> list[tuple[Heard, str]]:
    """The answers of which something is not done, each with what, in words.

    A script's item that another one follows, a stop as well, ends there by the script's own words.
    """
    items = [heard.item for heard in answers if heard.item is not None and heard.reached]
    last = max(items, default=None)
    found = ((heard, heard.failure or (heard.cut if heard.item == last else None)) for heard in answers)
    return [(heard, words) for heard, words in found if words is not None]


def merged(answers: list[Heard]) -> list[Heard]:
    """The newest version of each answer, in order of their first versions."""
    newest: dict[tuple[int, int | None], Heard] = {}
    for heard in answers:
        newest[heard.id, heard.item] = heard
    return list(newest.values())
