"""What `check latency` measured: times by stage, counts, and when the machine itself did not keep its pace."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Literal

from flexmotion.drivers.realtime.priority import Scheduling
from flexmotion.streamer.report.report import Latency

HISTOGRAM_US = (0.0, 25.0, 50.0, 75.0, 100.0, 150.0, 200.0, 300.0, 500.0, 1000.0, 2000.0, 4000.0, 8000.0)
"""Edges of the lateness histogram [µs]; one more bin holds what is later."""


MOST_LEFT_OUT = 0.10
"""Share of the ticks, or of the targets, in which the machine did not keep its pace, above which a run is unfit."""

Verdict = Literal["PASS", "FAIL", "UNFIT"]


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
        standstills, slowness: of the machine during the run; None where they were not measured.
        left_out: share of the ticks in which the machine did not keep its pace.
        faults: messages of faults.
        failures: budgets that were exceeded, in words, in all that was measured.
        failures_kept: likewise, while the machine kept its pace.
        unfit: why the run says nothing about the program, in words; empty where it does.
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
    taken_late: int
    underruns: int
    violations_sent: int
    lateness: tuple[int, ...]
    memory_mb: tuple[float, float] | None
    standstills: Standstills | None
    slowness: Slowness | None
    left_out: float
    faults: tuple[str, ...]
    failures: tuple[str, ...]
    failures_kept: tuple[str, ...]
    unfit: str

    @property
    def ok(self) -> bool:
        """Whether no budget was exceeded while the machine kept its pace, which was most of the time."""
        return self.verdict == "PASS"

    @property
    def verdict(self) -> Verdict:
        """Of the moments in which the machine kept its pace; UNFIT where they were too few."""
        return "UNFIT" if self.unfit else "FAIL" if self.failures_kept else "PASS"

    @property
    def verdict_all(self) -> Verdict:
        """Of all moments."""
        return "FAIL" if self.failures else "PASS"

    def content(self) -> dict[str, object]:
        """The result as JSON."""
        stages = {name: stage.content() for name, stage in self.stages.items()}
        verdicts = {"ok": self.ok, "verdict": self.verdict, "verdict_all": self.verdict_all}
        return asdict(self) | {"stages": stages, "histogram_us": HISTOGRAM_US} | verdicts


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
class Slowness:
    """Times in which all processors were slow, found by a fixed piece of work at the highest priority.

    Attributes:
        count: number of such times.
        longest_ms: the longest one [ms].
        share, idle_share: of the run, and of the idle machine before it.
        ours: the share has grown with the program's own load: it counts as the program's, and nothing is left out.
    """

    count: int
    longest_ms: float
    share: float
    idle_share: float
    ours: bool


@dataclass(frozen=True)
class Bound:
    """Budget of a stage.

    Attributes:
        percentile: "p50", "p95" or "p99".
        ms: greatest value [ms].
        of: the moments that it bounds; "both": all, and those in which the machine kept its pace, each by itself.
    """

    percentile: Literal["p50", "p95", "p99"]
    ms: float
    of: Literal["all", "kept", "both"] = "both"

    @property
    def name(self) -> str:
        """Of the percentile, in words."""
        return "median" if self.percentile == "p50" else f"{self.percentile[1:]} %"

    def exceeded(self, time: Latency | None) -> str | None:
        """Message if a time exceeds it, or if none was measured; None: it is kept."""
        if time is None:
            return "nothing was measured"
        found: float = getattr(time, self.percentile)
        return f"{self.name} {found:.3g} ms, {self.ms:g} ms allowed" if found > self.ms else None


@dataclass(frozen=True)
class Stage:
    """Time of one stage [ms].

    Attributes:
        time: percentiles; None where nothing was measured.
        bounds: budgets.
        kept: percentiles while the machine kept its pace; None where that is not known, or nothing was measured then.
        left_out: share of the measured times in which it did not.
    """

    time: Latency | None
    bounds: tuple[Bound, ...] = ()
    kept: Latency | None = None
    left_out: float = 0.0

    @property
    def failures(self) -> list[str]:
        """Budgets exceeded in all moments."""
        return self._exceeded(self.time, "kept")

    @property
    def failures_kept(self) -> list[str]:
        """Budgets exceeded while the machine kept its pace; those of all moments are among them."""
        whole = [bound.exceeded(self.time) for bound in self.bounds if bound.of == "all"]
        return [*(message for message in whole if message is not None), *self._exceeded(self.kept, "all")]

    def _exceeded(self, time: Latency | None, other: str) -> list[str]:
        found = [bound.exceeded(time) for bound in self.bounds if bound.of != other]
        return list(dict.fromkeys(message for message in found if message is not None))

    def content(self) -> dict[str, object]:
        """The stage as JSON."""
        time, kept = (None if one is None else one.model_dump() for one in (self.time, self.kept))
        p99 = next((bound.ms for bound in self.bounds if bound.percentile == "p99"), None)
        bounds = [asdict(bound) for bound in self.bounds]
        return {"ms": time, "budget_p99_ms": p99, "budgets": bounds, "kept_pace_ms": kept, "left_out": self.left_out}
