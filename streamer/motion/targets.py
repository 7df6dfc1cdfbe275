"""Targets: what the robot is to do next, sent from operators' processes to the planner's."""

from __future__ import annotations

import json
import math
import time
from dataclasses import dataclass
from threading import Lock
from typing import Any

import numpy as np

from flexmotion.configs.errors import ConfigError, SessionError
from flexmotion.drivers.realtime.ring import Reader, Ring
from flexmotion.records import Float, Int, Record, column
from flexmotion.streamer.motion.intents import WORDS, Clip, Heading, Intent, Stop, Text, Velocity, Waypoint, word_of
from flexmotion.streamer.motion.part_intents import PARTS, part_from_content
from flexmotion.streamer.motion.part_values import Logged

_TEXT_BYTES = 240
_PART_BYTES = 480
_KEPT = 64
_KINDS = tuple(WORDS)


class TargetRow(Record):
    """A target in shared memory."""

    id: Int = column("i8")
    stamp_ns: Int = column("i8")
    kind: Int = column("i8")
    """Index into the words of `flexmotion.streamer.motion.intents.WORDS`."""
    text: Any = column(f"S{_TEXT_BYTES}")
    """Of a clip (its name) and of a text, in UTF-8."""
    velocity: Float = column("f8", 3)
    """Forward, left [m/s], turning left [rad/s]."""
    goal: Float = column("f8", 4)
    """Of a heading: heading [rad], fastest turning [rad/s]; of a waypoint: x, y [m], heading [rad], tolerance [m]. NaN
    where none is said."""
    part: Any = column(f"S{_PART_BYTES}")
    """Of an intent for a part of the body: its fields as JSON, whose numbers come back bit by bit."""
    holds_s: Float = column("f8")
    """See `Target`; infinite where it holds until the next one."""
    take_up_s: Float = column("f8")


@dataclass(frozen=True)
class Target:
    """One target.

    Attributes:
        id: number, from 1, ascending.
        stamp_ns: when it was sent (`time.perf_counter_ns`).
        intent: what to do from now on.
        holds_s: the robot comes to a stand when the target is this old [s]; infinite: it holds until the next one.
        take_up_s: a target that no plan follows when it is this old is dropped [s].
    """

    id: int
    stamp_ns: int
    intent: Intent
    holds_s: float = math.inf
    take_up_s: float = math.inf

    def too_late(self, age_s: float) -> bool:
        """Whether it is too old to be followed [s]."""
        return age_s > self.take_up_s


NO_TARGET = Target(0, 0, Stop())


class TargetMailbox:
    """Targets in shared memory; the newest one counts.

    Each process that sends has an end of its own (`sender`), and none waits for another. Ids ascend over all of them:
    a target has a greater one than all that its sender could see.
    """

    def __init__(self) -> None:
        self._rings = [_new_ring()]
        self._end = TargetSender(self._rings, 0)

    def sender(self) -> TargetSender:
        """An end for another process; made before the first target is sent, and before that process is forked.

        Raises:
            SessionError: a target was sent already.
        """
        if any(ring.count for ring in self._rings):
            raise SessionError("targets: a sender is added before the first target is sent")
        self._rings.append(_new_ring())
        return TargetSender(self._rings, len(self._rings) - 1)

    def send(self, intent: Intent, *, holds_s: float = math.inf, take_up_s: float = math.inf) -> Target:
        """See `TargetSender.send`; the end of the process that made the mailbox."""
        return self._end.send(intent, holds_s=holds_s, take_up_s=take_up_s)

    def newest(self) -> Target:
        """The target that counts; `NO_TARGET` before the first."""
        rows = [row for row in (ring.latest() for ring in self._rings) if row is not None]
        return max(map(_target, map(TargetRow, rows)), key=lambda target: target.id, default=NO_TARGET)

    def reader(self) -> TargetReader:
        """A reader of all targets."""
        return TargetReader(self._rings)


class TargetSender:
    """One process's end of a mailbox.

    Args:
        rings: of all senders; the list may still grow.
        place: of its own ring among them.
    """

    def __init__(self, rings: list[Ring], place: int) -> None:
        self._rings, self._place = rings, place
        self._row = TargetRow(np.zeros((), TargetRow.dtype()))
        self._sending = Lock()

    def send(self, intent: Intent, *, holds_s: float = math.inf, take_up_s: float = math.inf) -> Target:
        """Publish a target; only one process may do so, from any thread.

        Args:
            intent: what to do from now on.
            holds_s, take_up_s: see `Target`.

        Raises:
            ConfigError: its text or name is too long, a time is not positive, a velocity has a manner, or a gesture is
                to be made beside it.
        """
        if not (holds_s > 0.0 and take_up_s > 0.0):
            raise ConfigError(f"target: holds_s {holds_s} and take_up_s {take_up_s}: expected positive times [s]")
        with self._sending:
            row = self._row
            row.kind[...], row.text[...], row.velocity[...] = _KINDS.index(word_of(intent)), b"", 0.0
            match intent:
                case Text(beside=Text(text)) | Velocity(beside=Text(text)):
                    raise ConfigError(
                        f"target: {word_of(intent)}: beside {text!r}: say both in words, as in 'walk while waving'"
                    )
                case Clip(text) | Text(text):
                    encoded = text.encode()
                    if len(encoded) > _TEXT_BYTES:
                        word = word_of(intent)
                        raise ConfigError(f"target: {word}: {len(encoded)} bytes, expected at most {_TEXT_BYTES}")
                    row.text[...] = encoded
                case Velocity(forward, left, turning, manner):
                    if manner is not None:
                        raise ConfigError(
                            f"target: velocity: manner {manner!r}: a target's velocity has the normal manner; say "
                            'the manner in words, such as Text("walk like an old man at 0.5 m/s")'
                        )
                    row.velocity[...] = forward, left, turning
                case Heading(heading, turning):
                    row.goal[:2] = heading, _or_nan(turning)
                case Waypoint(x, y, heading, tolerance):
                    row.goal[...] = x, y, _or_nan(heading), tolerance
                case Logged():
                    row.part[...] = json.dumps(intent.content(), ensure_ascii=False).encode()
            row.holds_s[...], row.take_up_s[...] = holds_s, take_up_s
            target = Target(self._next_id(), time.perf_counter_ns(), intent, holds_s, take_up_s)
            row.id[...], row.stamp_ns[...] = target.id, target.stamp_ns
            self._rings[self._place].publish(np.asarray(row.array))
        return target

    def _next_id(self) -> int:
        """The next number that is this sender's, after all that are known: no two senders share one."""
        newest = max((int(row["id"]) for row in (ring.latest() for ring in self._rings) if row is not None), default=0)
        senders = len(self._rings)
        return (newest // senders + 1) * senders + self._place if senders > 1 else newest + 1


class TargetReader:
    """Reads the targets of all senders of a mailbox."""

    def __init__(self, rings: list[Ring]) -> None:
        self._rings = rings
        self._readers: list[Reader] = []

    @property
    def has_new(self) -> bool:
        """Whether `read` would return a target."""
        self._know_all()
        return any(reader.has_new for reader in self._readers)

    def read(self) -> list[Target]:
        """The targets since the last call, by id."""
        self._know_all()
        found = [_target(TargetRow(row)) for reader in self._readers for row in reader.read()]
        return sorted(found, key=lambda target: target.id)

    def _know_all(self) -> None:
        """Read from senders that were added since the last call too."""
        self._readers += [ring.reader() for ring in self._rings[len(self._readers) :]]


def _new_ring() -> Ring:
    return Ring(TargetRow.dtype(), _KEPT)


def arrived(reader: TargetReader) -> list[Target]:
    """The targets since the last call."""
    return reader.read()


def _target(row: TargetRow) -> Target:
    return Target(int(row.id), int(row.stamp_ns), _intent(row), float(row.holds_s), float(row.take_up_s))


def _intent(row: TargetRow) -> Intent:
    kind = _KINDS[int(row.kind)]
    text = row.text.item().decode(errors="replace")
    if kind == "velocity":
        forward, left, turning = map(float, row.velocity)
        return Velocity(forward, left, turning)
    if kind == "heading":
        return Heading(float(row.goal[0]), _or_none(row.goal[1]))
    if kind == "waypoint":
        x, y, _, tolerance = map(float, row.goal)
        return Waypoint(x, y, _or_none(row.goal[2]), tolerance)
    if kind == "stop":
        return Stop()
    if kind in PARTS:
        return part_from_content(kind, json.loads(row.part.item()))
    return Clip(text) if kind == "clip" else Text(text)


def _or_nan(value: float | None) -> float:
    return math.nan if value is None else value


def _or_none(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None
