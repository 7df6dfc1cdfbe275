"""Targets: what the robot is asked to do next, on their way from whoever asks to the planner."""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np

from flexmotion.configs.errors import ConfigError
from flexmotion.drivers.realtime.ring import Reader, Ring
from flexmotion.streamer.motion.intents import WORDS, Clip, Intent, Stop, Text, Velocity, word_of

_TEXT_BYTES = 240
_KINDS = tuple(WORDS)
_DTYPE = np.dtype(
    [("id", "i8"), ("stamp_ns", "i8"), ("kind", "i8"), ("text", f"S{_TEXT_BYTES}"), ("velocity", "f8", 3)]
)


@dataclass(frozen=True)
class Target:
    """One target.

    Attributes:
        id: number, from 1, rising.
        stamp_ns: when it arrived (`time.perf_counter_ns`).
        intent: what is to be done from now on.
    """

    id: int
    stamp_ns: int
    intent: Intent


NO_TARGET = Target(0, 0, Stop())


class TargetMailbox:
    """Targets in shared memory; the newest one counts."""

    def __init__(self) -> None:
        self._ring = Ring(_DTYPE, 64)
        self._row = np.zeros((), _DTYPE)

    def send(self, intent: Intent) -> Target:
        """Ask for something, from the one process that owns this end.

        Raises:
            ConfigError: its text or name is too long.
        """
        row = self._row
        row["kind"], row["text"], row["velocity"] = _KINDS.index(word_of(intent)), b"", 0.0
        match intent:
            case Clip(text) | Text(text):
                encoded = text.encode()
                if len(encoded) > _TEXT_BYTES:
                    word = word_of(intent)
                    raise ConfigError(f"target: {word}: {len(encoded)} bytes, expected at most {_TEXT_BYTES}")
                row["text"] = encoded
            case Velocity(forward, left, turning):
                row["velocity"] = forward, left, turning
        target = Target(self._ring.count + 1, time.perf_counter_ns(), intent)
        row["id"], row["stamp_ns"] = target.id, target.stamp_ns
        self._ring.publish(row)
        return target

    def newest(self) -> Target:
        """The target that counts; `NO_TARGET` before the first."""
        row = self._ring.latest()
        return NO_TARGET if row is None else _target(row)

    def reader(self) -> Reader:
        """Follows all of them, for the log."""
        return self._ring.reader()


def arrived(reader: Reader) -> list[Target]:
    """The targets since the last call."""
    return [_target(row) for row in reader.read()]


def _target(row: np.ndarray) -> Target:
    return Target(int(row["id"]), int(row["stamp_ns"]), _intent(row))


def _intent(row: np.ndarray) -> Intent:
    kind = _KINDS[int(row["kind"])]
    text = bytes(row["text"]).decode(errors="replace")
    if kind == "velocity":
        return Velocity(*(float(value) for value in row["velocity"]))
    if kind == "stop":
        return Stop()
    return Clip(text) if kind == "clip" else Text(text)
