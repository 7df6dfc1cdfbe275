"""`measure`: latency of the live system on the real clock, while targets change at random moments."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Iterator, Sequence

import numpy as np
import psutil
from numpy.typing import NDArray

from flexmotion.configs.robot import Robot
from flexmotion.configs.stream import Budgets, StreamSettings
from flexmotion.drivers.interface import Driver
from flexmotion.drivers.realtime import child
from flexmotion.drivers.realtime.witness import Witness
from flexmotion.streamer.checks.latency_result import HISTOGRAM_US, Bound, LatencyResult, Stage
from flexmotion.streamer.checks.machine_pace import MachinePace
from flexmotion.streamer.checks.stages import of_ticks, stage, target_to_command, unfit
from flexmotion.streamer.checks.switching import BETWEEN_S, RandomTargets
from flexmotion.streamer.control.run_trace import RunTrace
from flexmotion.streamer.control.telemetry import Event
from flexmotion.streamer.motion.intents import Intent
from flexmotion.streamer.motion.sources import LiveSource
from flexmotion.streamer.report.report import Latency
from flexmotion.streamer.run.requests import Request
from flexmotion.streamer.run.session import Session

Float = NDArray[np.float64]

_MARGIN_S = 60.0
"""Part of a run that is kept beyond its switches: standing up, settling, parking [s]."""


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
    """Stream on the real clock and send targets at random moments.

    Args:
        source: source that follows the targets.
        intents: intents to send in random order, two or more.
        seconds: length of the measurement [s].
        switches: end after so many targets instead.
        load: number of busy processes beside the run.
        realtime: ask the system for realtime scheduling.
        progress: called with the share done, in [0, 1].
        request, wake: see `flexmotion.streamer.run.session.Session`.

    Raises:
        DriverError: the driver failed.
    """
    longest = seconds if switches is None else switches * BETWEEN_S[1]
    session = Session(
        robot,
        driver,
        source,
        settings,
        stay=True,
        realtime=realtime,
        wake=wake,
        kept_s=longest + _MARGIN_S,
        clock="real",
    )
    switcher = _Switcher(session, intents, seconds, switches, seed, progress, request)
    session.next_request = switcher.next
    witness = Witness()
    # The witness watches the idle machine first, without the load.
    with witness if realtime else contextlib.nullcontext(), hogs(load):
        before = _stolen_ms()
        record = session.run()
    pace = MachinePace.of(record, witness, _stolen_ms() - before) if session.scheduling == "fifo" else None
    return _result(record, session, settings.budgets, load, switcher, pace)


class _Switcher:
    """Sends targets until the measurement is over, then asks for the end; passes on requests from outside.

    Attributes:
        interrupted: the end was requested from outside. No target is sent after that: the robot parks.
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
        """Number of targets sent."""
        return self._targets.sent

    def next(self) -> Request | None:
        """The next request; the supervisor calls this repeatedly."""
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
    """Time since the machine started in which it was ready to run but its host ran something else [ms]."""
    return 1e3 * float(psutil.cpu_times().steal)


def _stages(record: RunTrace, budgets: Budgets, pace: MachinePace | None) -> dict[str, Stage]:
    """The times of each stage; of those that end in a tick also while the machine kept its pace."""
    plans = record.plans
    after = record.target_to_effect_s - record.target_to_command_s
    return {
        "loop work": of_ticks(pace, record.work_s, Bound("p99", budgets.loop_work_p99_ms), after=record.work_s),
        "wake lateness": of_ticks(pace, record.lateness_s, Bound("p99", budgets.wake_lateness_p99_ms)),
        "robot lateness": of_ticks(pace, record.robot_lateness_s),
        "sample": stage(np.array([plan.sample_s for plan in plans])),
        "retarget": stage(np.array([plan.retarget_s for plan in plans])),
        "plan joins after": stage(np.array([(p.join_tick - p.asked_tick) / record.rate_hz for p in plans])),
        "target to command": target_to_command(record, budgets, pace),
        "target to effect": of_ticks(pace, record.target_to_effect_s, after=after),
    }


def _result(
    record: RunTrace,
    session: Session,
    budgets: Budgets,
    load: int,
    switcher: _Switcher,
    pace: MachinePace | None,
) -> LatencyResult:
    stages = _stages(record, budgets, pace)
    failures = ["interrupted"] if switcher.interrupted else []
    answered, sent = int(np.isfinite(record.target_to_command_s).sum()), switcher.sent
    if answered < sent - 1:  # the end may overtake the last one
        failures.append(f"{sent - answered} of {sent} targets were not followed")
    faults = tuple(_fault_text(event, record, pace) for event in record.events if event.kind == "fault")
    for what, count, allowed in (
        ("under-runs", record.underruns, budgets.underruns),
        ("goals outside the envelope", record.violations_sent, 0),
    ):
        if count > allowed:
            failures.append(f"{what}: {count}, {allowed} allowed")
    if session.scheduling != "fifo":
        failures.append("no realtime scheduling (SCHED_FIFO): figures do not count")
    failures += [f"fault: {fault}" for fault in faults]
    robot, missed = stages["robot lateness"], record.missed_deadlines
    kept = failures + [f"{name}: {message}" for name, stage in stages.items() for message in stage.failures_kept]
    kept += _lateness(robot.kept, missed if pace is None else pace.missed_kept, budgets, record.rate_hz)
    failures += [f"{name}: {message}" for name, stage in stages.items() for message in stage.failures]
    failures += _lateness(robot.time, missed, budgets, record.rate_hz)
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
        taken_late=sum(plan.join_tick > plan.start_tick for plan in record.plans),
        underruns=record.underruns,
        violations_sent=record.violations_sent,
        lateness=tuple(int(n) for n in np.histogram(late, [*HISTOGRAM_US, np.inf])[0]),
        memory_mb=session.memory_mb,
        standstills=None if pace is None else pace.standstills,
        slowness=None if pace is None else pace.slowness,
        left_out=0.0 if pace is None else pace.left_out,
        faults=faults,
        failures=tuple(failures),
        failures_kept=tuple(failures if pace is None else kept),
        unfit="" if pace is None else unfit(pace, stages["target to command"]),
    )


def _lateness(robot: Latency | None, missed: int, budgets: Budgets, rate_hz: float) -> list[str]:
    """Failures of the loop and of the simulated robot, each in words."""
    found = []
    if robot is not None and robot.p99_9 > 1e3 / rate_hz:
        # One late step of the simulation moves no percentile that is judged; one in a thousand may.
        told = f"the simulated robot was {robot.p99_9:.3g} ms late (99.9 %), more than a tick"
        found.append(f"{told}: figures do not count")
    if missed > budgets.missed_deadlines:
        found.append(f"missed deadlines: {missed}, {budgets.missed_deadlines} allowed")
    return found


def _fault_text(event: Event, record: RunTrace, pace: MachinePace | None) -> str:
    """Message of a fault with its time, and with a standstill that may have caused it."""
    if not record.used:
        return event.message
    row = int(np.searchsorted(record.rows["tick"], event.tick))
    stamp = int(record.stamp_ns[min(row, record.used - 1)])
    at_s = 1e-9 * (stamp - int(record.stamp_ns[0]))
    return f"{event.message}, at {at_s:.1f} s{'' if pace is None else pace.just_before(stamp)}"


@contextlib.contextmanager
def hogs(count: int) -> Iterator[None]:
    """Context in which `count` processes each keep a processor busy."""
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
