"""A whole run: robot up, source streamed, robot parked; on a clock that steps (lockstep) or one that passes (real)."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from functools import partial
from types import TracebackType
from typing import Literal, Self

import numpy as np

from flexmotion.configs.errors import ConfigError, FlexMotionError
from flexmotion.configs.robot import Robot
from flexmotion.configs.stream import StreamSettings
from flexmotion.drivers.interface import Driver
from flexmotion.drivers.realtime.priority import Scheduling, awake
from flexmotion.human.contacts import ContactDetector
from flexmotion.human.motion import Motion
from flexmotion.retarget.human import HumanWindow
from flexmotion.retarget.retargeter import Retargeter
from flexmotion.streamer.control.loop import ControlLoop
from flexmotion.streamer.control.plan_buffer import PlanBuffer
from flexmotion.streamer.control.run_trace import KEPT_S, Collector, RunTrace
from flexmotion.streamer.control.telemetry import Event, Telemetry
from flexmotion.streamer.motion.intents import Intent
from flexmotion.streamer.motion.replan_noise import NoisySource
from flexmotion.streamer.motion.sources import LiveSource, Performance, Source
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
"""What plans are taken to cost before any was made [s]."""


@dataclass
class Session:
    """One robot, one source, one run.

    Args:
        seconds: longest that the source is streamed; None: to its end [s].
        feedback: whether balance feedback acts.
        stay: on the real clock: go on standing when the source is over, until somebody asks for the end.
        realtime: on the real clock: ask the system for realtime scheduling.
        progress: called each tick with the time of the source that plays [s].
        request: asked each tick (on the real clock every 20 ms) what an operator wants, if anything.
        wake: file descriptor that becomes readable when `request` should be asked sooner.
        tell: told of every event as it happens.
        kept_s: how much of the run, its end, the record keeps [s].
        services: what follows the run in processes of their own on the real clock, in this one in lockstep.
        seed: of the driver and the source, for the log and the report.
        clock: what `run` runs on where it is not told otherwise.
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
    request: Callable[[], Request | None] | None = None
    wake: int | None = None
    kept_s: float = KEPT_S
    tell: Callable[[Event], None] = lambda _event: None
    services: tuple[Service, ...] = ()
    seed: int = 0
    clock: Clock = "lockstep"
    elapsed_s: float | None = field(init=False, default=None)
    """Wall-clock time that the last run took [s]."""
    controls: RequestChannel = field(init=False)
    """For requests from this process that must be heard on the next tick; a signal handler may use it."""
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
        self.controls = RequestChannel()
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
            ConfigError: lockstep is asked for with a driver whose time cannot be stepped.
            DriverError: the driver failed.
        """
        begin = time.perf_counter()
        clock = self.clock if clock is None else clock
        try:
            return self._run_real() if clock == "real" else self._run_lockstep()
        finally:
            self.elapsed_s = time.perf_counter() - begin

    def __enter__(self) -> Self:
        """Begin a lockstep run that `step` and `advance` carry on; see `lockstep` for the errors."""
        self._begin_s = time.perf_counter()
        self._entered = ExitStack()
        self._step = self._entered.enter_context(self.lockstep())
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._step = None
        self._entered.__exit__(kind, error, trace)
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
        """Ask for the end and step to it: the robot comes to a balanced stop, parks, torque goes off. See `step`."""
        self.ask(Request.END)
        while self.step():
            pass
        return self.record

    def send(self, intent: Intent) -> Target:
        """Set the target that the robot follows from now on.

        Raises:
            ConfigError: the source follows no targets, or the target's text is too long.
        """
        if not isinstance(self.source, LiveSource):
            raise ConfigError(f"{self.source.name}: a source that follows no targets; a model or a clip library does")
        return self.targets.send(intent)

    def ask(self, request: Request) -> None:
        """Ask for a stop, an emergency stop or the end; it acts on the next tick."""
        self.controls.ask(request)

    @property
    def state(self) -> SessionState:
        """The newest tick, in lockstep and on the real clock. Raises `LookupError` before the first."""
        row = self.telemetry.ticks.latest()
        if row is None:
            raise LookupError("the run has no tick yet")
        return SessionState.of(row, self.robot.rate_hz)

    def control_loop(self, driver: Driver) -> ControlLoop:
        """The loop of this run."""
        # A retargeter of its own: the planner's works in another process.
        retargeter = Retargeter(self.robot, self.settings)
        return ControlLoop(self.robot, driver, retargeter, self.plans, self.telemetry, feedback=self.feedback)

    def _planning(self, lead: Lead, tell: Callable[[str], None]) -> Replanner:
        return Replanner(self.planner, self.plans, self.telemetry.ticks, self.settings, self.targets, lead, tell)

    @contextmanager
    def lockstep(self) -> Iterator[Callable[[], bool]]:
        """Within: the driver is open, and each call of the function that is yielded runs one tick.

        The function returns whether the run goes on. On leaving, services end and the driver is closed: torque is off.

        Raises:
            ConfigError: the driver's time cannot be stepped.
            DriverError: the driver failed.
        """
        if not self.driver.capabilities.lockstep:
            raise ConfigError(f"driver {self.driver.name!r} runs on the real clock only; use --clock real")
        self.clock = "lockstep"
        period = 1.0 / self.robot.rate_hz
        lead = FixedLead(max(round(self.settings.commit_s * self.robot.rate_hz), 1))
        replanner = self._planning(lead, partial(self.controls.ask, Request.NOTE))
        collector = Collector(self.telemetry, self.record)
        followers = [service.follow() for service in self.services]
        with ExitStack() as ending, self.driver:
            for follow in followers:
                ending.callback(follow, True)
            loop = self.loop = self.control_loop(self.driver)
            lifecycle = Lifecycle(loop, self.settings, seconds=self.seconds, stay=False)
            listener = self.controls.listener()

            def step() -> bool:
                if lifecycle.finished:
                    return False
                asked = None if self.request is None else self.request()
                if asked is not None:
                    lifecycle.hear(asked)
                for heard, reason in listener.heard():
                    lifecycle.hear(heard, reason)
                lifecycle.act()
                if lifecycle.broken is None:
                    try:
                        replanner.step(loop.tick_count)
                    except (FlexMotionError, ArithmeticError, ValueError, LookupError) as error:
                        # What plays ends in its own stop.
                        lifecycle.broken = f"{type(error).__name__}: {error}"
                loop.tick()
                self.driver.advance(period)
                for event in collector.collect():
                    self.tell(event)
                for follow in followers:
                    follow(False)
                if self.progress is not None:
                    self.progress(float(self.record.source_s[-1]))
                return not lifecycle.finished

            yield step

    def _run_lockstep(self) -> RunTrace:
        with self.lockstep() as step:
            while step():
                pass
        return self.record

    def _run_real(self) -> RunTrace:
        self.clock = "real"
        driver = self.driver
        if driver.capabilities.lockstep:
            driver = driver.detached(realtime=self.realtime)
        planner_controls = RequestChannel()
        lead = MeasuredLead(self.robot.rate_hz, _AT_FIRST_S, self.settings.horizon_s - self.settings.replan_s)
        supervisor = Supervisor(
            self.control_loop(driver),
            self._planning(lead, partial(planner_controls.ask, Request.NOTE)),
            self.settings,
            (self.controls, planner_controls),
            seconds=self.seconds,
            stay=self.stay,
            realtime=self.realtime,
            services=self.services,
            wake=self.wake,
        )
        collector = Collector(self.telemetry, self.record)
        with awake(self.settings.wake_latency_us if self.realtime else None) as self.awake:
            self.scheduling = supervisor.run(collector, self.request, self.progress, self.tell)
        self.memory_mb = supervisor.memory_mb
        return self.record


def human_motion(source: Source, record: RunTrace) -> Motion | None:
    """What the human did in a run, as far as it was played; None where nobody can tell.

    Nobody can of a source that followed targets, and of a run that is longer than what a record keeps.
    """
    if isinstance(source, NoisySource):
        return human_motion(source.source, record)
    if not isinstance(source, Performance):
        return None
    if not isinstance(source, LiveSource):
        return source.human()
    played = record.source_s[record.source_s >= 0.0]
    if not len(played) or played[-1] > KEPT_S or record.rows["target"].any():
        return None
    return source.cut(min(float(played[-1]) + 1.0 / source.fps, source.seconds or np.inf)).human()


def count_human_steps(motion: Motion, retargeter: Retargeter) -> int:
    """Steps that the human makes in a motion, by the measure of the footstep planner."""
    window = HumanWindow(motion, 0.0, ContactDetector().initial(), None)
    return sum(1 for swing in window.swings if swing.landed and retargeter.footsteps.worth(window, swing))
