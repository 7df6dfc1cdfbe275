"""Answers: what became of every target, published by the planner for whoever sent it."""

from __future__ import annotations

import time
from dataclasses import dataclass
from enum import IntEnum
from typing import Any

import numpy as np

from flexmotion.drivers.realtime.ring import Reader, Ring
from flexmotion.records import Float, Int, Record, column

_HEARD_BYTES, _REASON_BYTES = 96, 392
_KEPT = 256


class TargetState(IntEnum):
    """What became of a target. Each target has exactly one of these.

    ACCEPTED: the loop plays a plan that follows it. SUPERSEDED: a newer target came before a plan followed it. EXPIRED:
    its time was over before a plan followed it. REFUSED: it cannot be followed; the robot does not do it.
    """

    ACCEPTED = 1
    SUPERSEDED = 2
    EXPIRED = 3
    REFUSED = 4


@dataclass(frozen=True)
class Heard:
    """How a source understands an intent.

    Attributes:
        kind: kind of motion that words are taken for; empty for other intents.
        certainty: cosine of the words with the nearest known wording; NaN for other intents.
        slowed_to: velocity of the human in its heading frame, where it is slower than asked, so that the robot keeps
            up; forward, left [m/s], turning left [rad/s].
        refusal: why the robot stands still instead; empty where it does as asked.
    """

    kind: str = ""
    certainty: float = float("nan")
    slowed_to: tuple[float, float, float] | None = None
    refusal: str = ""


@dataclass(frozen=True)
class TargetAnswer:
    """What became of one target.

    Attributes:
        target: its id.
        state: what became of it.
        tick: first tick of the plan that follows it; -1 where none does.
        heard: how it was understood.
        reason: why it is not followed, or why not as asked; empty where there is nothing to say.
    """

    target: int
    state: TargetState
    tick: int = -1
    heard: Heard = Heard()
    reason: str = ""


class AnswerRow(Record):
    """An answer in shared memory."""

    target: Int = column("i8")
    stamp_ns: Int = column("i8")
    """`time.perf_counter_ns` at which it was published."""
    state: Int = column("i8")
    tick: Int = column("i8")
    certainty: Float = column("f8")
    slowed_to: Float = column("f8", 3)
    """NaN where the intent is not slowed."""
    kind: Any = column(f"S{_HEARD_BYTES}")
    reason: Any = column(f"S{_REASON_BYTES}")


class AnswerChannel:
    """Answers in shared memory; the planner writes, any number of processes read, none waits."""

    def __init__(self) -> None:
        self._ring = Ring(AnswerRow.dtype(), _KEPT)
        self._row = AnswerRow(np.zeros((), AnswerRow.dtype()))

    def publish(self, answer: TargetAnswer) -> None:
        """Publish an answer; only one process may do so. A reason longer than 392 bytes is cut."""
        row, heard = self._row, answer.heard
        row.target[...], row.stamp_ns[...] = answer.target, time.perf_counter_ns()
        row.state[...], row.tick[...] = answer.state, answer.tick
        row.certainty[...], row.slowed_to[...] = heard.certainty, heard.slowed_to or np.nan
        row.kind[...] = heard.kind.encode()[:_HEARD_BYTES]
        row.reason[...] = (answer.reason or heard.refusal).encode()[:_REASON_BYTES]
        self._ring.publish(np.asarray(row.array))

    def reader(self) -> Reader:
        """A reader of the answers from now on."""
        return self._ring.reader(new_only=True)


def answers(reader: Reader) -> list[TargetAnswer]:
    """The answers since the last call, in order."""
    return [_answer(AnswerRow(row)) for row in reader.read()]


def _answer(row: AnswerRow) -> TargetAnswer:
    slowed = None if np.isnan(row.slowed_to[0]) else (*map(float, row.slowed_to),)
    heard = Heard(row.kind.item().decode(errors="replace"), float(row.certainty), slowed)  # type: ignore[arg-type]
    reason = row.reason.item().decode(errors="replace")
    return TargetAnswer(int(row.target), TargetState(int(row.state)), int(row.tick), heard, reason)
