"""`Session`: one run of a robot that follows a source with given settings, in lockstep or on the real clock.

`flexmotion.streamer.run.lifecycle.Lifecycle` is the robot's course through it: start, stream, settle, park.
`flexmotion.streamer.run.supervisor.Supervisor` starts and checks its processes on the real clock.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from functools import partial
from types import TracebackType
from typing import Literal, Self

from flexmotion.configs.errors import ConfigError, FlexMotionError
from flexmotion.configs.robot import Robot
from flexmotion.configs.stream import StreamSettings
from flexmotion.drivers.interface import Driver
from flexmotion.drivers.realtime.priority import Scheduling, awake
from flexmotion.drivers.simulated import lockstep
from flexmotion.retarget.retargeter import Retargeter
from flexmotion.streamer.control.loop import ControlLoop
from flexmotion.streamer.control.plan_buffer import PlanBuffer
from flexmotion.streamer.control.run_trace import KEPT_S, Collector, RunTrace
from flexmotion.streamer.control.telemetry import Event, Telemetry
from flexmotion.streamer.motion.intents import Intent
from flexmotion.streamer.motion.sources import LiveSource, Source
from flexmotion.streamer.motion.targets import Target, TargetMailbox
from flexmotion.streamer.planning.lead import FixedLead, Kind, Lead, MeasuredLead
from flexmotion.streamer.planning.planner import Planner
from flexmotion.streamer.planning.replanning import Replanner
from flexmotion.streamer.run.lifecycle import MARGIN_S, Lifecycle
from flexmotion.streamer.run.requests import Request, RequestChannel
from flexmotion.streamer.run.session_state import SessionState
from flexmotion.streamer.run.supervisor import Service, Supervisor

Clock = Literal["real", "lockstep"]

_AT_FIRST_S = {Kind.WHOLE: 0.05, Kind.PARTIAL: 0.02, Kind.STOP: 0.02}
"""Assumed time to make a plan, before any was made [s]."""


@dataclass
class Session:
    """One robot, one source, one run.

    Args:
        seconds: how much of the source is streamed at most [s]; None: all of it.
        feedback: whether balance feedback acts.
        stay: on the real clock: stand on when the source is over, until the end is requested.
        realtime: on the real clock: ask the system for realtime scheduling.
        progress: called each tick with the time of the source that plays [s].
        next_request: called each tick (on the real clock every 20 ms) for an operator's request; None: there is none.
        wake: file descriptor that becomes readable when `next_request` should be called sooner.
        on_event: called with every event as it happens.
        kept_s: the record keeps this much of the run, its end [s].
        services: recorder, viewer and the like; on the real clock each runs in a process of its own.
        seed: of the driver and the source, for the log and the report.
        clock: of `run`, where no other is given.

    Attributes:
        requests: for requests from this process that must act on the next tick; a signal handler may use it.
        elapsed_s: wall-clock time that the last run took [s]; None before its end.
    """

    robot: Robot
    driver: Driver
    source: Source
    settings: StreamSettings
    seconds: float | None = None
    feedback: bool = True
    stay: bool = False
    realtime: bool = True
    progress: Callable[[float], None] | None = None
    next_request: Callable[[], Request | None] | None = None
    wake: int | None = None
    kept_s: float = KEPT_S
    on_event: Callable[[Event], None] = lambda _event: None
    services: tuple[Service, ...] = ()
    seed: int = 0
    clock: Clock = "lockstep"
    elapsed_s: float | None = field(init=False, default=None)
    requests: RequestChannel = field(init=False)
    telemetry: Telemetry = field(init=False)
    plans: PlanBuffer = field(init=False)
    targets: TargetMailbox = field(init=False)
    planner: Planner = field(init=False)
    record: RunTrace = field(init=False)
    loop: ControlLoop | None = field(init=False, default=None)
    scheduling: Scheduling = field(init=False, default="other")
    awake: bool = field(init=False, default=False)
    """Whether processors were kept from sleeping in the last run on the real clock."""
    memory_mb: tuple[float, float] | None = field(init=False, default=None)
    _entered: ExitStack = field(init=False, repr=False)
    _step: Callable[[], bool] | None = field(init=False, default=None, repr=False)
    _begin_s: float = field(init=False, default=0.0, repr=False)

    def __post_init__(self) -> None:
        robot, rate = self.robot, self.robot.rate_hz
        retargeter = Retargeter(robot, self.settings)
        self.requests = RequestChannel()
        self.telemetry = Telemetry(robot.n, rate)
        self.plans = PlanBuffer(robot.n, retargeter.layout.size, retargeter.horizon, rate)
        self.targets = TargetMailbox()
        self.planner = Planner(retargeter, self.source, self.settings)
        self.record = RunTrace(rate, robot.joint_names, kept_s=max(self.kept_s, (self.seconds or 0.0) + MARGIN_S))

    def run(self, clock: Clock | None = None) -> RunTrace:
        """Run to the end and return the record.

        Args:
            clock: "lockstep" or "real"; None: the session's own.

        Raises:
            ConfigError: the clock is lockstep and the driver's time cannot be stepped.
            DriverError: the driver failed.
        """
        clock = self.clock if clock is None else clock
        if clock == "lockstep":
            with self:
                while self.step():
                    pass
            return self.record
        begin_s = time.perf_counter()
        try:
            return self._run_real()
        finally:
            self.elapsed_s = time.perf_counter() - begin_s

    # ---------------------------------------------------------------- stepped by a program, in lockstep

    def __enter__(self) -> Self:
        """Open the driver and begin a lockstep run that `step` and `advance` carry on.

        Raises:
            ConfigError: the driver's time cannot be stepped.
            DriverError: the driver failed.
        """
        self._begin_s = time.perf_counter()
        self._entered = ExitStack()
        self._step = self._entered.enter_context(self._stepped())
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """End the services and close the driver: torque is off."""
        self._step = None
        try:
            self._entered.__exit__(kind, error, trace)
        finally:
            self.elapsed_s = time.perf_counter() - self._begin_s

    def step(self) -> bool:
        """Run one tick; returns whether the run goes on.

        Raises:
            RuntimeError: the session has not been entered (`with session:`).
            DriverError: the driver failed.
        """
        if self._step is None:
            raise RuntimeError("a session is stepped within its context: with session: session.step()")
        return self._step()

    def advance(self, seconds: float) -> bool:
        """Run as many ticks as `seconds` hold, fewer where the run ends; returns whether it goes on. See `step`."""
        return all(self.step() for _ in range(round(seconds * self.robot.rate_hz)))

    def finish(self) -> RunTrace:
        """Request the end and step to it: the robot comes to a balanced stop, parks, torque goes off. See `step`."""
        self.ask(Request.END)
        while self.step():
            pass
        return self.record

    # ---------------------------------------------------------------- on either clock

    def send(self, intent: Intent) -> Target:
        """Set the target that the robot follows from now on.

        Raises:
            ConfigError: the source follows no targets, or the target's text is too long.
        """
        if not isinstance(self.source, LiveSource):
            raise ConfigError(f"{self.source.name}: a source that follows no targets; a model or a clip library does")
        return self.targets.send(intent)

    def ask(self, request: Request) -> None:
        """Request a stop, an emergency stop or the end; it acts on the next tick."""
        self.requests.send(request)

    @property
    def state(self) -> SessionState:
        """The newest tick. Raises `LookupError` before the first."""
        row = self.telemetry.ticks.latest()
        if row is None:
            raise LookupError("the run has no tick yet")
        return SessionState.of(row, self.robot.rate_hz)

    def control_loop(self, driver: Driver) -> ControlLoop:
        """The loop of this run."""
        # A retargeter of its own: the planner's works in another process.
        retargeter = Retargeter(self.robot, self.settings)
        return ControlLoop(self.robot, driver, retargeter, self.plans, self.telemetry, feedback=self.feedback)

    def _replanner(self, lead: Lead, on_note: Callable[[str], None]) -> Replanner:
        return Replanner(self.planner, self.plans, self.telemetry.ticks, self.settings, self.targets, lead, on_note)

    @contextmanager
    def _stepped(self) -> Iterator[Callable[[], bool]]:
        """A lockstep run: each call of the function runs one tick and returns whether the run goes on."""
        driver = lockstep(self.driver)
        if driver is None:
            raise ConfigError(f"driver {self.driver.name!r} runs on the real clock only; use --clock real")
        self.clock = "lockstep"
        period = 1.0 / self.robot.rate_hz
        lead = FixedLead(max(round(self.settings.commit_s * self.robot.rate_hz), 1))
        replanner = self._replanner(lead, partial(self.requests.send, Request.NOTE))
        collector = Collector(self.telemetry, self.record)
        followers = [service.follow() for service in self.services]
        with ExitStack() as ending, driver:
            for follow in followers:
                ending.callback(follow, True)
            loop = self.loop = self.control_loop(driver)
            lifecycle = Lifecycle(loop, self.settings, seconds=self.seconds, stay=False)
            requests = self.requests.reader()

            def step() -> bool:
                if lifecycle.finished:
                    return False
                request = None if self.next_request is None else self.next_request()
                if request is not None:
                    lifecycle.request(request)
                for sent, reason in requests.read():
                    lifecycle.request(sent, reason)
                lifecycle.step()
                if lifecycle.broken is None:
                    try:
                        replanner.step(loop.tick_count)
                    except (FlexMotionError, ArithmeticError, ValueError, LookupError) as error:
                        # The plan that plays ends in its own stop.
                        lifecycle.broken = f"{type(error).__name__}: {error}"
                loop.tick()
                driver.advance(period)
                for event in collector.collect():
                    self.on_event(event)
                for follow in followers:
                    follow(False)
                if self.progress is not None:
                    self.progress(float(self.record.source_s[-1]))
                return not lifecycle.finished

            yield step

    def _run_real(self) -> RunTrace:
        self.clock = "real"
        stepped = lockstep(self.driver)
        driver = self.driver if stepped is None else stepped.detached(realtime=self.realtime)
        planner_requests = RequestChannel()
        lead = MeasuredLead(self.robot.rate_hz, _AT_FIRST_S, self.settings.horizon_s - self.settings.replan_s)
        supervisor = Supervisor(
            self.control_loop(driver),
            self._replanner(lead, partial(planner_requests.send, Request.NOTE)),
            self.settings,
            (self.requests, planner_requests),
            seconds=self.seconds,
            stay=self.stay,
            realtime=self.realtime,
            services=self.services,
            wake=self.wake,
        )
        collector = Collector(self.telemetry, self.record)
        with awake(self.settings.wake_latency_us if self.realtime else None) as self.awake:
            self.scheduling = supervisor.run(collector, self.next_request, self.progress, self.on_event)
        self.memory_mb = supervisor.memory_mb
        return self.record
