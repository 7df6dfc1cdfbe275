"""Targets: what the robot is to do next, sent from an operator's process to the planner's."""

from __future__ import annotations

import time
from dataclasses import dataclass
from threading import Lock
from typing import Any

import numpy as np

from flexmotion.configs.errors import ConfigError
from flexmotion.drivers.realtime.ring import Reader, Ring
from flexmotion.records import Float, Int, Record, column
from flexmotion.streamer.motion.intents import WORDS, Clip, Intent, Stop, Text, Velocity, word_of

_TEXT_BYTES = 240
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


@dataclass(frozen=True)
class Target:
    """One target.

    Attributes:
        id: number, from 1, ascending.
        stamp_ns: when it was sent (`time.perf_counter_ns`).
        intent: what to do from now on.
    """

    id: int
    stamp_ns: int
    intent: Intent


NO_TARGET = Target(0, 0, Stop())


class TargetMailbox:
    """Targets in shared memory; the newest one counts."""

    def __init__(self) -> None:
        self._ring = Ring(TargetRow.dtype(), 64)
        self._row = TargetRow(np.zeros((), TargetRow.dtype()))
        self._sending = Lock()

    def send(self, intent: Intent) -> Target:
        """Publish a target; only one process may do so, from any thread.

        Raises:
            ConfigError: its text or name is too long.
        """
        with self._sending:
            row = self._row
            row.kind[...], row.text[...], row.velocity[...] = _KINDS.index(word_of(intent)), b"", 0.0
            match intent:
                case Clip(text) | Text(text):
                    encoded = text.encode()
                    if len(encoded) > _TEXT_BYTES:
                        word = word_of(intent)
                        raise ConfigError(f"target: {word}: {len(encoded)} bytes, expected at most {_TEXT_BYTES}")
                    row.text[...] = encoded
                case Velocity(forward, left, turning):
                    row.velocity[...] = forward, left, turning
            target = Target(self._ring.count + 1, time.perf_counter_ns(), intent)
            row.id[...], row.stamp_ns[...] = target.id, target.stamp_ns
            self._ring.publish(np.asarray(row.array))
        return target

    def newest(self) -> Target:
        """The target that counts; `NO_TARGET` before the first."""
        row = self._ring.latest()
        return NO_TARGET if row is None else _target(TargetRow(row))

    def reader(self) -> Reader:
        """A reader of all of them, for the log."""
        return self._ring.reader()


def arrived(reader: Reader) -> list[Target]:
    """The targets since the last call."""
    return [_target(TargetRow(row)) for row in reader.read()]


def _target(row: TargetRow) -> Target:
    return Target(int(row.id), int(row.stamp_ns), _intent(row))


def _intent(row: TargetRow) -> Intent:
    kind = _KINDS[int(row.kind)]
    text = row.text.item().decode(errors="replace")
    if kind == "velocity":
        return Velocity(*(float(value) for value in row.velocity))
    if kind == "stop":
        return Stop()
    return Clip(text) if kind == "clip" else Text(text)
