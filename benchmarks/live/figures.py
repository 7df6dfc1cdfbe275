"""`SegmentFigures`: what one segment of a soak has found, as a line of its checkpoint file."""

from __future__ import annotations

from collections import Counter

import numpy as np
from pydantic import BaseModel, ConfigDict

SETTLED_S = 120.0
"""After this time every buffer of a run has its full size [s]."""


class SegmentFigures(BaseModel):
    """One segment.

    Attributes:
        clock, seed, targets: how it was run: with targets over the transports, or without.
        seconds: of the robot.
        falls: times that the robot fell; the run went on after each.
        violations: goals outside the envelope that were sent.
        missed: ticks that were not done in time; of a segment on the wall clock.
        sent: targets by transport.
        states: their answers by state.
        memory: time of the run and memory of all its processes [s, MB].
        parts: files of the log; `unreadable` of them could not be read.
        exit_code: of the program; 0 where the segment has none of its own.
    """

    model_config = ConfigDict(extra="forbid")

    clock: str
    seed: int
    targets: bool
    seconds: float
    falls: int = 0
    violations: int = 0
    missed: int = 0
    sent: dict[str, int] = {}
    states: dict[str, int] = {}
    memory: list[tuple[float, float]] = []
    parts: int = 0
    unreadable: int = 0
    exit_code: int = 0

    @property
    def growth_mb(self) -> float | None:
        """Growth of memory in ten minutes, by a line through the samples after the start [MB]; None: too few."""
        known = np.array([one for one in self.memory if one[0] >= SETTLED_S]).reshape(-1, 2)
        if len(known) < 10:
            return None
        return float(np.polyfit(known[:, 0], known[:, 1], 1)[0] * 600.0)


def total(segments: list[SegmentFigures], name: str) -> Counter[str]:
    """Counts of all segments together: `sent` or `states`."""
    counted = Counter[str]()
    for one in segments:
        counted.update(getattr(one, name))
    return counted
