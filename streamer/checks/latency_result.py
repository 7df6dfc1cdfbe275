"""What `check latency` measured: times by stage, counts, and the machine's own standstills."""

from __future__ import annotations

from dataclasses import asdict, dataclass

from flexmotion.drivers.realtime.priority import Scheduling
from flexmotion.streamer.report.report import Latency

HISTOGRAM_US = (0.0, 25.0, 50.0, 75.0, 100.0, 150.0, 200.0, 300.0, 500.0, 1000.0, 2000.0, 4000.0, 8000.0)
"""Edges of the lateness histogram [µs]; one more bin holds what is later."""


@dataclass(frozen=True)
class LatencyResult:
    """What was measured.

    Attributes:
        seconds, rate_hz, cycles: length of the run [s], rate of the loop, and ticks.
        stages: times by the stage's name.
        scheduling: scheduling class of the loop.
        awake: whether the processors were kept out of deep sleep states.
        load: busy processes beside the run.
        switches, answered: targets sent, and targets that a plan followed.
        lateness: count of ticks in each bin of `HISTOGRAM_US`.
        memory_mb: memory of the loop's process, early in the run and at its end [MB].
        standstills: of the machine during the run; None where they were not measured.
        faults: messages of faults.
        failures: budgets that were exceeded, in words.
    """

    seconds: float
    rate_hz: float
    cycles: int
    stages: dict[str, Stage]
    scheduling: Scheduling
    awake: bool
    load: int
    switches: int
    answered: int
    missed_deadlines: int
    late_plans: int
    underruns: int
    violations_sent: int
    lateness: tuple[int, ...]
    memory_mb: tuple[float, float] | None
    standstills: Standstills | None
    faults: tuple[str, ...]
    failures: tuple[str, ...]

    @property
    def ok(self) -> bool:
        """Whether no budget was exceeded."""
        return not self.failures

    def content(self) -> dict[str, object]:
        """The result as JSON."""
        stages = {name: stage.content() for name, stage in self.stages.items()}
        return asdict(self) | {"stages": stages, "histogram_us": HISTOGRAM_US, "ok": self.ok}


@dataclass(frozen=True)
class Standstills:
    """Standstills: times in which the machine ran no process, found by a timer of the highest priority.

    Attributes:
        count: number of standstills.
        total_ms, longest_ms: sum over all processors, and the longest one [ms].
        missed_deadlines: deadlines of the loop missed during a standstill, or in catching up after it.
        stolen_ms: time that the host of a virtual machine reports as taken from it, in steps of 10 ms.
    """

    count: int
    total_ms: float
    longest_ms: float
    missed_deadlines: int
    stolen_ms: float


@dataclass(frozen=True)
class Stage:
    """Time of one stage [ms].

    Attributes:
        time: percentiles; None where nothing was measured.
        budget_ms: upper bound of the 99th percentile; None: no bound.
        apart: percentiles without the standstills of the machine; None where they are not known.
    """

    time: Latency | None
    budget_ms: float | None = None
    apart: Latency | None = None

    @property
    def over(self) -> bool:
        """Whether the 99th percentile exceeds the budget."""
        return self.budget_ms is not None and self.time is not None and self.time.p99 > self.budget_ms

    def content(self) -> dict[str, object]:
        """The stage as JSON."""
        time, apart = (None if one is None else one.model_dump() for one in (self.time, self.apart))
        return {"ms": time, "budget_p99_ms": self.budget_ms, "apart_from_standstills_ms": apart}
