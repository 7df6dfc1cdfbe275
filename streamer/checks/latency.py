"""`measure`: the live system on the real clock while targets change at random moments; how fast it answers."""

from __future__ import annotations

import contextlib
import random
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, replace

import numpy as np
import psutil
from numpy.typing import NDArray

from flexmotion.configs.robot import Robot
from flexmotion.configs.stream import Budgets, StreamSettings
from flexmotion.drivers.interface import Driver
from flexmotion.drivers.realtime import child
from flexmotion.drivers.realtime.priority import Scheduling
from flexmotion.drivers.realtime.witness import Witness, overlapping
from flexmotion.human.motion import Motion
from flexmotion.importers.default_clip import default_clip
from flexmotion.streamer.control.run_trace import RunTrace
from flexmotion.streamer.control.telemetry import Event
from flexmotion.streamer.motion.clip_library import ClipLibrary
from flexmotion.streamer.motion.intents import Clip, Intent
from flexmotion.streamer.motion.sources import LiveSource
from flexmotion.streamer.motion.targets import TargetMailbox
from flexmotion.streamer.report.report import Latency
from flexmotion.streamer.run.requests import Request
from flexmotion.streamer.run.session import Session

_SETTLE_S = 2.0
"""After the start, before the first switch [s]."""
_MARGIN_S = 60.0
"""Kept of a run beyond its switches: standing up, settling, parking [s]."""
_BETWEEN_S = (0.2, 1.0)
"""Time between two switches, drawn evenly [s]."""
_SOON_S, _LONG_S = 2.0, 0.02
"""A standstill so shortly before a fault, and so long, may be its cause [s]."""
HISTOGRAM_US = (0.0, 25.0, 50.0, 75.0, 100.0, 150.0, 200.0, 300.0, 500.0, 1000.0, 2000.0, 4000.0, 8000.0)
"""Edges of the lateness histogram [µs]; one more bin holds what is later."""


@dataclass(frozen=True)
class LatencyResult:
    """What was measured.

    Attributes:
        stages: by name, a time's percentiles in milliseconds, the budget of one of them, and which one it binds.
        scheduling: of the loop.
        awake: whether the processors were kept from sleeping as deeply as they like.
        switches, answered: targets sent, and those that a plan followed.
        lateness: ticks by how late the loop woke, one a bin of `HISTOGRAM_US`.
        memory_mb: of the loop's process, early in the run and at its end.
        standstills: of this machine meanwhile; None where nothing could tell.
        failures: budgets that were passed, in words.
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
        """Whether every budget was kept."""
        return not self.failures

    def content(self) -> dict[str, object]:
        """All of it as JSON has it."""
        stages = {name: stage.content() for name, stage in self.stages.items()}
        return asdict(self) | {"stages": stages, "histogram_us": HISTOGRAM_US, "ok": self.ok}


@dataclass(frozen=True)
class Standstills:
    """Moments at which this machine itself ran nothing, as a timer above every other process found them.

    Attributes:
        count: how many; `total_ms` what they add up to on all processors, `longest_ms` the longest.
        missed_deadlines: those of the loop that were missed in one, or catching up.
        stolen_ms: what the host of a virtual machine says that it took meanwhile; in steps of 10 ms.
    """

    count: int
    total_ms: float
    longest_ms: float
    missed_deadlines: int
    stolen_ms: float


@dataclass(frozen=True)
class Stage:
    """One stage's time in milliseconds, and the 99th percentile that it may have; None where nothing is asked.

    Attributes:
        apart: the time where the machine did not stand still meanwhile; None where that is not known.
    """

    time: Latency | None
    budget_ms: float | None = None
    apart: Latency | None = None

    @property
    def over(self) -> bool:
        """Whether it takes longer than it may."""
        return self.budget_ms is not None and self.time is not None and self.time.p99 > self.budget_ms

    def content(self) -> dict[str, object]:
        """As JSON has it."""
        time, apart = (None if one is None else one.model_dump() for one in (self.time, self.apart))
        return {"ms": time, "budget_p99_ms": self.budget_ms, "apart_from_standstills_ms": apart}


def measure(
    robot: Robot,
    driver: Driver,
    settings: StreamSettings,
    source: LiveSource,
    intents: Sequence[Intent],
    *,
    seconds: float,
    switches: int | None = None,
    load: int = 0,
    realtime: bool = True,
    seed: int = 0,
    progress: Callable[[float], None] | None = None,
    request: Callable[[], Request | None] = lambda: None,
    wake: int | None = None,
) -> LatencyResult:
    """Stream on the real clock, asking for something else at random moments.

    Args:
        source: what follows.
        intents: what it is asked for in turn, two or more.
        seconds: how long; `switches`: until so many switches were made, where given.
        load: processes that keep a processor busy meanwhile.
        realtime: ask the system for realtime scheduling.
        request, wake: as of `flexmotion.streamer.run.session.Session`.
    """
    longest = seconds if switches is None else switches * _BETWEEN_S[1]
    session = Session(
        robot, driver, source, settings, stay=True, realtime=realtime, wake=wake, kept_s=longest + _MARGIN_S
    )
    switcher = _Switcher(session, intents, seconds, switches, seed, progress, request)
    session.next_request = switcher.next
    before, witness = _stolen_ms(), Witness()
    with hogs(load), witness if realtime else contextlib.nullcontext():
        record = session.run("real")
    found = witness.standstills() if session.scheduling == "fifo" else None
    moments = None if found is None else Moments(record, found, _stolen_ms() - before)
    return _result(record, session, settings.budgets, load, switcher, moments)


def shipped_clips() -> dict[str, Motion]:
    """The shipped motion in parts: both arms waving, a few steps, standing at ease."""
    motion = default_clip()
    return {"wave": motion[0:225], "walk": motion[225:330], "stand": motion[330:510]}


def switched(clips: dict[str, Motion]) -> tuple[ClipLibrary, tuple[Intent, ...]]:
    """A source that plays clips, beginning with the first, and what it can be asked for."""
    return ClipLibrary(clips, next(iter(clips))), tuple(Clip(name) for name in sorted(clips))


class RandomTargets:
    """Sends targets at random moments, never the same twice in a row.

    Args:
        targets: where they are sent.
        intents: what they ask for, two or more.
        seed: of moments and choices.

    Attributes:
        sent: how many.
    """

    def __init__(self, targets: TargetMailbox, intents: Sequence[Intent], seed: int) -> None:
        self.targets, self.intents = targets, intents
        self.sent = 0
        self._random, self._next = random.Random(seed), _SETTLE_S
        self._asked: Intent | None = None

    def at(self, passed: float) -> None:
        """Called over and over with the time since the start [s]."""
        if passed >= self._next:
            self._next = passed + self._random.uniform(*_BETWEEN_S)
            self._asked = self._random.choice([intent for intent in self.intents if intent != self._asked])
            self.targets.send(self._asked)
            self.sent += 1


class _Switcher:
    """Sends targets until it is time to end, and then asks for that; passes on what is requested meanwhile.

    Attributes:
        interrupted: somebody else asked for the end. A robot that comes to a stand and parks follows nothing more.
    """

    def __init__(
        self,
        session: Session,
        intents: Sequence[Intent],
        seconds: float,
        switches: int | None,
        seed: int,
        progress: Callable[[float], None] | None,
        request: Callable[[], Request | None],
    ) -> None:
        self.session, self.seconds, self.switches = session, seconds, switches
        self.progress, self.request = progress, request
        self.interrupted = self._ended = False
        self._begin: float | None = None
        self._targets = RandomTargets(session.targets, intents, seed)

    @property
    def sent(self) -> int:
        """How many targets."""
        return self._targets.sent

    def next(self) -> Request | None:
        """Called by the supervisor over and over."""
        asked = self.request()
        if asked in (Request.END, Request.ESTOP, Request.KILL, Request.QUIT) and not self._ended:
            self.interrupted = self._ended = True
        if asked is not None or self._ended:
            return asked
        now = time.perf_counter()
        if self._begin is None:
            if self.session.telemetry.ticks.count:
                self._begin = now
            return None
        passed = now - self._begin
        share = passed / self.seconds if self.switches is None else self.sent / self.switches
        if self.progress is not None:
            self.progress(min(share, 1.0))
        if share >= 1.0:
            self._ended = True
            return Request.END
        self._targets.at(passed)
        return None


def _stolen_ms() -> float:
    """Time since the start that this machine was ready to run and its host ran something else."""
    return 1e3 * float(psutil.cpu_times().steal)


def _ns(seconds: NDArray[np.float64] | float) -> NDArray[np.int64]:
    return np.asarray(np.nan_to_num(np.asarray(seconds) * 1e9), np.int64)


class Moments:
    """The machine's standstills, laid beside a run."""

    def __init__(self, record: RunTrace, found: NDArray[np.int64], stolen_ms: float) -> None:
        first, last = (int(record.stamp_ns[at]) for at in (0, -1))
        self._stamps = record.stamp_ns
        self._moments = found[(found[:, 1] > first) & (found[:, 0] < last)]
        ms = (self._moments[:, 1] - self._moments[:, 0]) * 1e-6
        # From a deadline to the next wake all is one cause: who woke late ends late, and misses the next deadline.
        missed = np.diff(record.rows["missed_deadlines"], prepend=0)
        since = np.concatenate([[first], self._stamps[:-1] - _ns(record.lateness_s[:-1])])
        theirs = int(missed[overlapping(since, self._stamps, self._moments)].sum())
        longest = float(ms.max(initial=0.0))
        self.summary = Standstills(len(ms), float(ms.sum()), longest, theirs, stolen_ms)

    def just_before(self, stamp_ns: int) -> str:
        """For a message of something that happened then: the longest standstill of the last moments, if it was long."""
        ended = (self._moments[:, 1] > stamp_ns - _ns(_SOON_S)) & (self._moments[:, 0] < stamp_ns)
        longest = max(self._moments[ended].tolist(), key=lambda moment: moment[1] - moment[0], default=[0, 0])
        stood_s, ago_s = 1e-9 * (longest[1] - longest[0]), 1e-9 * (stamp_ns - longest[1])
        if stood_s < _LONG_S:
            return ""
        return f", {max(ago_s, 0.0):.2f} s after the machine itself stood still for {1e3 * stood_s:.0f} ms"

    def apart(self, seconds: NDArray[np.float64], after: NDArray[np.float64] | float = 0.0) -> Latency | None:
        """Times of each tick, (T,) [s], without those in which the machine stood still.

        Args:
            after: how much of each came after the tick's wake, (T,) or one for all [s].
        """
        end = self._stamps + _ns(after)
        return Latency.of(seconds[~overlapping(end - _ns(seconds), end, self._moments)], 1e-3)


def _result(
    record: RunTrace, session: Session, budgets: Budgets, load: int, switcher: _Switcher, moments: Moments | None
) -> LatencyResult:
    def stage(seconds: NDArray[np.float64], budget_ms: float | None = None) -> Stage:
        return Stage(Latency.of(seconds, 1e-3), budget_ms)

    def of_ticks(
        seconds: NDArray[np.float64], budget_ms: float | None = None, after: NDArray[np.float64] | float = 0.0
    ) -> Stage:
        apart = None if moments is None else moments.apart(seconds, after)
        return replace(stage(seconds, budget_ms), apart=apart)

    plans = record.plans
    stages = {
        "loop work": of_ticks(record.work_s, budgets.loop_work_p99_ms, record.work_s),
        "wake lateness": of_ticks(record.lateness_s, budgets.wake_lateness_p99_ms),
        "robot lateness": of_ticks(record.robot_lateness_s),
        "sample": stage(np.array([plan.sample_s for plan in plans])),
        "retarget": stage(np.array([plan.retarget_s for plan in plans])),
        "plan joins after": stage(np.array([(p.join_tick - p.asked_tick) / record.rate_hz for p in plans])),
        "target to command": of_ticks(record.target_to_command_s, budgets.target_to_command_ms),
        "target to effect": of_ticks(
            record.target_to_effect_s, after=record.target_to_effect_s - record.target_to_command_s
        ),
    }
    failures = ["interrupted"] if switcher.interrupted else []
    failures += [
        f"{name}: p99 {stage.time.p99:.3g} ms, budget {stage.budget_ms:g} ms"
        for name, stage in stages.items()
        if stage.over and stage.time is not None
    ]
    unmeasured = [name for name, stage in stages.items() if stage.budget_ms is not None and stage.time is None]
    failures.extend(f"{name}: nothing was measured" for name in unmeasured)
    answered, sent = int(np.isfinite(record.target_to_command_s).sum()), switcher.sent
    if answered < sent - 1:  # the end may overtake the last one
        failures.append(f"{sent - answered} of {sent} switches were not followed")
    robot_late = stages["robot lateness"].time
    if robot_late is not None and robot_late.max > 1e3 / record.rate_hz:
        failures.append(f"the simulated robot was {robot_late.max:.3g} ms late, more than a tick: figures do not count")
    faults = tuple(_told(event, record, moments) for event in record.events if event.kind == "fault")
    for what, count, allowed in (
        ("missed deadlines", record.missed_deadlines, budgets.missed_deadlines),
        ("under-runs", record.underruns, budgets.underruns),
        ("goals outside the envelope", record.violations_sent, 0),
    ):
        if count > allowed:
            failures.append(f"{what}: {count}, budget {allowed}")
    if session.scheduling != "fifo":
        failures.append("no realtime scheduling (SCHED_FIFO): figures do not count")
    late = record.lateness_s * 1e6
    return LatencyResult(
        seconds=record.used / record.rate_hz,
        rate_hz=record.rate_hz,
        cycles=record.used,
        stages=stages,
        scheduling=session.scheduling,
        awake=session.awake,
        load=load,
        switches=sent,
        answered=answered,
        missed_deadlines=record.missed_deadlines,
        late_plans=record.late_plans,
        underruns=record.underruns,
        violations_sent=record.violations_sent,
        lateness=tuple(int(n) for n in np.histogram(late, [*HISTOGRAM_US, np.inf])[0]),
        memory_mb=session.memory_mb,
        standstills=None if moments is None else moments.summary,
        faults=faults,
        failures=(*failures, *(f"fault: {fault}" for fault in faults)),
    )


def _told(event: Event, record: RunTrace, moments: Moments | None) -> str:
    """A fault, when it was, and whether the machine may have been its cause."""
    if not record.used:
        return event.message
    row = int(np.searchsorted(record.rows["tick"], event.tick))
    stamp = int(record.stamp_ns[min(row, record.used - 1)])
    at_s = 1e-9 * (stamp - int(record.stamp_ns[0]))
    return f"{event.message}, at {at_s:.1f} s{'' if moments is None else moments.just_before(stamp)}"


@contextlib.contextmanager
def hogs(count: int) -> Iterator[None]:
    """Within, `count` processes each keep a processor busy."""
    running = [child.start("hog", _be_busy) for _ in range(count)]
    try:
        yield
    finally:
        for one in running:
            one.kill()
            one.join()


def _be_busy() -> None:
    values = np.arange(1000.0)
    while True:
        values = np.sqrt(values + 1.0)
