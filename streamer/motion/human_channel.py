"""`HumanChannel`: the human that the planner follows, as points, for those who show a run."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexmotion.drivers.realtime.ring import Ring, shared_array
from flexmotion.human.kinematics import forward
from flexmotion.human.motion import Motion
from flexmotion.records import Float, Int, Record, column

_SIDED = ("hip", "knee", "ankle", "heel", "toe", "shoulder", "elbow", "hand")
POINTS = ("pelvis", "vertex", *(f"{side}_{name}" for side in ("left", "right") for name in _SIDED))
"""Points of the human, in their order."""

_FRAMES = 96
_KEPT = 16
_WATCHED_S = 3.0
"""Nobody watches who has not said so for this long [s]."""


class HumanRow(Record):
    """The human of one plan."""

    plan: Int = column("i8")
    first_frame: Int = column("i8")
    count: Int = column("i8")
    fps: Float = column("f8")
    points: Any = column("f4", _FRAMES, len(POINTS), 3)
    """In the human's world [m], by frame, `count` of them."""


@dataclass(frozen=True)
class Human:
    """The human of one plan.

    Attributes:
        plan: its id.
        first_frame, fps: frame of the source at the first row, and frames a second.
        points: (T, P, 3) [m], in the order of `POINTS`.
    """

    plan: int
    first_frame: int
    fps: float
    points: NDArray[np.float32]

    def at(self, source_s: float) -> NDArray[np.float32] | None:
        """The points at a time of the source, between frames by interpolation, (P, 3) [m]; None beyond them."""
        place = source_s * self.fps - self.first_frame
        if not 0.0 <= place <= len(self.points) - 1:
            return None
        before = min(int(place), len(self.points) - 2)
        if before < 0:
            return self.points[0]
        share = np.float32(place - before)
        return (1 - share) * self.points[before] + share * self.points[before + 1]


class HumanChannel:
    """Shared memory from the planner's process to those who show a run; nothing is written while nobody watches."""

    def __init__(self) -> None:
        self._ring = Ring(HumanRow.dtype(), _KEPT)
        self._watched_ns = shared_array(1, np.int64)
        self._row = HumanRow(np.zeros((), HumanRow.dtype()))

    def watch(self) -> None:
        """Say that someone watches; to be repeated every second."""
        self._watched_ns[0] = time.perf_counter_ns()

    @property
    def watched(self) -> bool:
        """Whether anyone watches."""
        return bool(self._watched_ns[0]) and time.perf_counter_ns() - int(self._watched_ns[0]) < _WATCHED_S * 1e9

    def publish(self, plan: int, human: Motion, first_frame: int) -> None:
        """Publish the human of a plan; the planner alone may do so."""
        shown = human[:_FRAMES]
        row, count = self._row, len(shown)
        row.plan[...], row.first_frame[...], row.count[...], row.fps[...] = plan, first_frame, count, human.fps
        row.points[:count] = points_of(shown)
        self._ring.publish(np.asarray(row.array))

    def newest(self) -> Human | None:
        """The human of the newest plan; None before the first."""
        found = self._ring.latest()
        if found is None:
            return None
        row = HumanRow(found)
        return Human(int(row.plan), int(row.first_frame), float(row.fps), row.points[: int(row.count)])


def points_of(human: Motion) -> NDArray[np.float32]:
    """Points of every frame, (T, P, 3) [m]."""
    found = forward(human)
    sided = np.stack([getattr(found, name) for name in _SIDED], axis=1)  # (T, name, side, 3)
    sides = [sided[:, :, side] for side in (0, 1)]
    single = np.stack([found.pelvis_position, found.vertex], axis=1)
    return np.concatenate([single, *sides], axis=1).astype(np.float32)
