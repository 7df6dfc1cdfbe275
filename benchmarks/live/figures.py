"""`SegmentFigures`: what one segment of a soak has found, as a line of its checkpoint file."""

from __future__ import annotations

from collections import Counter

from pydantic import BaseModel, ConfigDict

from benchmarks.shared.memory import Growth, Sample, growth


class Fall(BaseModel):
    """A fall, or another end of following: when, why, and what was asked shortly before.

    Attributes:
        cause: in the loop's words.
        asked: oldest first, each with its time [s] and its answer.
    """

    model_config = ConfigDict(extra="forbid")

    at_s: float
    cause: str | None = None
    asked: list[str] = []


class SegmentFigures(BaseModel):
    """One segment.

    Attributes:
        clock, seed, targets: how it was run: with targets over the transports, or the same ones without.
        seconds: of the robot.
        falls: the run went on after each.
        violations: goals outside the envelope that were sent.
        missed: ticks that were not done in time; of a segment on the wall clock.
        robot_late_ms: most by which the simulated robot was late [ms]: a machine that has no time for it makes it fall,
            and counts goals against a robot that stood still meanwhile.
        sent: targets by transport.
        states: their answers by state.
        memory: of each process, by its name.
        parts: files of the log; `unreadable` of them could not be read.
        exit_code: of the program; 0 where the segment has none of its own.
    """

    model_config = ConfigDict(extra="forbid")

    clock: str
    seed: int
    targets: bool
    seconds: float = 0.0
    falls: list[Fall] = []
    violations: int = 0
    missed: int = 0
    robot_late_ms: float = 0.0
    sent: dict[str, int] = {}
    states: dict[str, int] = {}
    memory: dict[str, list[Sample]] = {}
    parts: int = 0
    unreadable: int = 0
    exit_code: int = 0

    @property
    def growths(self) -> dict[str, Growth]:
        """Growth of each process in ten minutes; of a segment that is long enough."""
        found = {name: growth(samples) for name, samples in self.memory.items()}
        return {name: one for name, one in found.items() if one is not None}


def total(segments: list[SegmentFigures], name: str) -> Counter[str]:
    """Counts of all segments together: `sent` or `states`."""
    counted = Counter[str]()
    for one in segments:
        counted.update(getattr(one, name))
    return counted
