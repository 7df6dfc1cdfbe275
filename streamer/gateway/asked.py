"""`Asked`: a message that waits for its answer; `Following`: what the robot follows; `Sequences`: message numbers."""

from __future__ import annotations

import math
from collections import OrderedDict
from collections.abc import Callable, Hashable
from dataclasses import dataclass, field, replace
from typing import Any

from flexmotion.streamer.gateway.messages import Answer, Ended, Message, StopMessage, TargetEnd, TextMessage
from flexmotion.streamer.motion.heard import HeardStep
from flexmotion.streamer.motion.intents import Intent
from flexmotion.streamer.planning.standstill import LONGEST_SETTLE_S
from flexmotion.text.alarm import is_alarm

Reply = Callable[[Answer], None]
OnEnd = Callable[[Ended], None]

WHOLE_BODY = "whole body"
"""The part of targets that are none for a part."""

_SOURCES = 256
"""Sources whose sequence numbers are remembered."""

MEASURED_S = LONGEST_SETTLE_S + 1.0
"""Longest time from a stand to the measurement of what the robot has done until then, or to its next move [s]: it is
measured this long after it was told to stand at the latest, and a plan is made."""

TYPED_STOP = "taken as STOP: targets are refused until `clear`; EMERGENCY STOP is its own button, or `flexmotion estop`"
"""What is answered to words of alarm. They are told from others by a list of words: no emergency stop depends on it."""


@dataclass
class Asked:
    """A message that is not answered yet."""

    message: Message
    reply: Reply
    since_s: float
    on_end: OnEnd | None = None
    """Takes the end of a target; None: its sender is not told."""
    sender: Hashable = None
    """Connection that it came by; None: one of its own."""
    took_from: str | None = None
    due_s: float = math.inf
    """When the gateway answers by itself [s]."""
    intent: Intent | None = None
    part: str = WHOLE_BODY
    """Of a target: the part of the body that it is for."""
    holds_s: float = math.inf
    tick: int = -1
    """Of a request: the tick before which the loop took it."""
    known: dict[str, Any] = field(default_factory=dict)
    """Fields of the answer that are known before."""


def asked_of(message: Message, reply: Reply, since_s: float, on_end: OnEnd | None = None) -> Asked:
    """A message that has arrived; words of alarm are a STOP, which needs no lease and no order of arrival."""
    if not (isinstance(message, TextMessage) and is_alarm(message.text)):
        return Asked(message, reply, since_s, on_end)
    stop = StopMessage(id=message.id, source=message.source, sequence=message.sequence)
    known = {"asked": message.type, "heard_as": "stop", "notes": (TYPED_STOP,)}
    return Asked(stop, reply, since_s, known=known)


@dataclass(frozen=True)
class Following:
    """The newest target that was accepted.

    Attributes:
        source: who sent it.
        asked: its word and value, as in a script.
        answer: as its sender got it.
        stamp_s: when it was accepted, on the gateway's clock [s].
        holds_s: it is over after this time [s].
        on_end: takes its end.
        steps: its steps, in the newest version of the planner's answer; dropped: what that names, likewise.
        stood_s: since when the robot stands though it is followed [s]; None: it does not.
        end: how it has ended; None: it goes on, or has no end.
    """

    source: str
    asked: dict[str, object]
    answer: Answer
    stamp_s: float
    holds_s: float = math.inf
    on_end: OnEnd | None = None
    steps: tuple[HeardStep, ...] = ()
    dropped: tuple[str, ...] = ()
    stood_s: float | None = None
    end: TargetEnd | None = None

    @property
    def last(self) -> HeardStep | None:
        """Its last step; None: it has none."""
        return self.steps[-1] if self.steps else None

    @property
    def measured_end(self) -> TargetEnd | None:
        """How it has ended by its steps: as the last one, or by the time limit of an earlier one; None: it goes on."""
        if self.last is None or self.last.end is None:
            return None
        late = self.last.end == "done" and any(step.end == "time limit" for step in self.steps)
        return "time limit" if late else self.last.end

    @property
    def stands_s(self) -> float:
        """How long the robot may stand while it is followed, until it is over [s]: for what is still measured."""
        last, now = self.last, next((step for step in self.steps if step.end is None), None)
        if last is None or not last.is_measured:
            return 0.0
        waits_s = now.amount if now is not None and now.unit == "time" else None
        return MEASURED_S + (waits_s or 0.0)

    def ended(self, end: TargetEnd, why: str | None = None) -> Following:
        """The same at its end, of which its sender is told once, with what was left out since its answer.

        `why`: it was given up.
        """
        if self.end is not None:
            return self
        if self.on_end is not None and self.answer.target is not None:
            over = [step for step in self.steps if step.end is not None]
            done = over[0].done if len(self.steps) == 1 and over else None
            if why is not None:
                done = why
            elif len(self.steps) > 1 and over:
                done = "; ".join(f"{step.text}: {step.fate}" for step in over)
            answer = self.answer
            if since := [part for part in self.dropped if part not in (answer.dropped or ())]:
                done = ", ".join(filter(None, (done, f"without {', '.join(since)}")))
            self.on_end(Ended(id=answer.id, source=answer.source, target=self.answer.target, end=end, done=done))
        return replace(self, end=end)


@dataclass(frozen=True)
class Waiter:
    """A program that waits for the end of a target for a part of the body, or of a restriction.

    Attributes:
        source, id: of its message; on_end: takes its end.
        part: it is a part, which a stop ends.
    """

    source: str
    id: str | None
    on_end: OnEnd
    part: bool

    def tell(self, target: int, end: TargetEnd, done: str | None = None) -> None:
        """Tell the end of the target of this number; `done`: what was measured of it, in words."""
        self.on_end(Ended(id=self.id, source=self.source, target=target, end=end, done=done))


class Sequences:
    """The last sequence number of each sender's sources.

    A number is forgotten with its connection, and after a silence: a program that is started again counts anew.

    Args:
        silence_s: after it the numbers of a source begin anew [s].
    """

    def __init__(self, silence_s: float) -> None:
        self._silence_s = silence_s
        self._last: OrderedDict[tuple[Hashable, str], tuple[int, float]] = OrderedDict()

    def ascends(self, message: Message, sender: Hashable, now_s: float) -> bool:
        """Take a message's number; returns whether it comes after the last one, or it has none."""
        if message.sequence is None:
            return True
        key = (sender, message.source)
        last, then_s = self._last.get(key, (-1, now_s))
        if message.sequence <= last and now_s - then_s <= self._silence_s:
            return False
        self._last[key] = message.sequence, now_s
        self._last.move_to_end(key)
        while len(self._last) > _SOURCES:
            self._last.popitem(last=False)
        return True

    def forget(self, sender: Hashable) -> None:
        """A connection is closed."""
        for key in [key for key in self._last if key[0] == sender]:
            del self._last[key]
