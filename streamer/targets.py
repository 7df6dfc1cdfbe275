"""Targets: what the robot is asked to do next, on their way from whoever asks to the planner."""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np

from configs.errors import ConfigError
from drivers.realtime.ring import Reader, Ring

_NAME_BYTES = 240
_DTYPE = np.dtype([("id", "i8"), ("stamp_ns", "i8"), ("clip", f"S{_NAME_BYTES}")])


@dataclass(frozen=True)
class Target:
    """One target.

    Attributes:
        id: number, from 1, rising.
        stamp_ns: when it arrived (`time.perf_counter_ns`).
        clip: name of the clip to follow from now on.
    """

    id: int
    stamp_ns: int
    clip: str


NO_TARGET = Target(0, 0, "")


class TargetMailbox:
    """Targets in shared memory; the newest one counts."""

    def __init__(self) -> None:
        self._ring = Ring(_DTYPE, 64)
        self._row = np.zeros((), _DTYPE)

    def send(self, clip: str) -> Target:
        """Ask for a clip, from the one process that owns this end.

        Raises:
            ConfigError: the name is too long.
        """
        name = clip.encode()
        if len(name) > _NAME_BYTES:
            raise ConfigError(f"target: clip: {len(name)} bytes, expected at most {_NAME_BYTES}")
        target = Target(self._ring.count + 1, time.perf_counter_ns(), clip)
        self._row["id"], self._row["stamp_ns"], self._row["clip"] = target.id, target.stamp_ns, name
        self._ring.publish(self._row)
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
    return Target(int(row["id"]), int(row["stamp_ns"]), bytes(row["clip"]).decode(errors="replace"))
