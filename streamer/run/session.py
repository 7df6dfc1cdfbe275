"""`Session`: one run of a robot that follows a source with given settings, in lockstep or on the real clock.

`flexmotion.streamer.run.lifecycle.Lifecycle` is the robot's course through it: start, stream, settle, park.
`flexmotion.streamer.run.supervisor.Supervisor` starts and checks its processes on the real clock.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from enum import Enum
from functools import partial
from types import TracebackType
from typing import Literal, Self, get_args

from flexmotion.configs.errors import ConfigError, FlexMotionError, SessionError
from flexmotion.configs.robot import Robot
from flexmotion.configs.stream import StreamSettings
from flexmotion.drivers.interface import Driver
from flexmotion.drivers.realtime.priority import Scheduling, awake
from flexmotion.drivers.realtime.ring import Reader
from flexmotion.drivers.simulated import lockstep
from flexmotion.retarget.retargeter import Retargeter
from flexmotion.streamer.control.loop import ControlLoop
from flexmotion.streamer.control.plan_buffer import PlanBuffer
from flexmotion.streamer.control.run_trace import KEPT_S, Collector, RunTrace
from flexmotion.streamer.control.telemetry import Event, Telemetry
from flexmotion.streamer.control.tick_row import TickRow, blank
from flexmotion.streamer.motion.heard import Heard, HeardChannel, heard_since, merged
from flexmotion.streamer.motion.human_channel import HumanChannel
from flexmotion.streamer.motion.intents import WORDS, Intent
from flexmotion.streamer.motion.model_source import ModelSource
from flexmotion.streamer.motion.replan_noise import NoisySource
from flexmotion.streamer.motion.sources import LiveSource, Performance, Source
from flexmotion.streamer.motion.targets import Target, TargetMailbox
from flexmotion.streamer.planning.lead import FixedLead, Kind, Lead, MeasuredLead
from flexmotion.streamer.planning.planner import Planner
from flexmotion.streamer.planning.replanning import Replanner
from flexmotion.streamer.run.lifecycle import MARGIN_S, Lifecycle
from flexmotion.streamer.run.requests import Request, RequestChannel
from flexmotion.streamer.run.session_state import SessionState
from flexmotion.streamer.run.supervisor import Service, Supervisor, requests_of

Clock = Literal["real", "lockstep"]


class Phase(Enum):
    """A session is run once."""

    NEW = "has not begun"
    RUNNING = "is running"
    ENDED = "has ended"


_HEARD_KEPT = 1000
"""Answers to targets that a session keeps."""

_AT_FIRST_S = {Kind.WHOLE: 0.05, Kind.PARTIAL: 0.02, Kind.STOP: 0.02}
"""Assumed time to make a plan, before any was made [s]."""


@dataclass(eq=False, repr=False)
class Session:
    """One robot, one source, one run.

    Args:
        seconds: how much of the source is streamed at most [s]; None: all of it.
        feedback: whether balance feedback acts.
        stay: keep standing after the source has ended, until END is requested. None: only where a program steps the run
            and its source follows targets without an end.
        realtime: on the real clock: ask the system for realtime scheduling.
        progress: called each tick with the time of the source that plays [s].
        next_request: called before each tick (on the real clock every 20 ms) for an operator's request; None: none. It
            may read `state` and `send` targets.
        wake: file descriptor that becomes readable when `next_request` should be called sooner.
        on_event: called with every event as it happens.
        kept_s: the record keeps this much of the run, its end [s].
        services: recorder, viewer and the like; on the real clock each runs in a process of its own.
        seed: of the driver and the source, for the log and the report.
        clock: "lockstep" or "real".
        waits: on the real clock, a robot that is not there is waited for; else it is an error.
        allow_refused: for the report: what was refused or dropped does not make it fail.
        armed: torque goes on with the first tick; else with the request ARM.
        attended: the run goes on in OFF and in FAULT until END: CLEAR and ARM lead back to READY.

    Attributes:
        requests: those of `ask`. A signal handler does not use them: it may interrupt one that is being sent.
        phase: whether the run has begun and ended.
        elapsed_s: wall-clock time that the last run took [s]; None before its end.
    """

    robot: Robot
    driver: Driver
    source: Source
    settings: StreamSettings
    seconds: float | None = None
    feedback: bool = True
    stay: bool | None = None
    realtime: bool = True
    progress: Callable[[float], None] | None = None
    next_request: Callable[[], Request | None] | None = None
    wake: int | None = None
    kept_s: float = KEPT_S
    on_event: Callable[[Event], None] = lambda _event: None
    services: tuple[Service, ...] = ()
    seed: int = 0
    clock: Clock = "lockstep"
    allow_refused: bool = False
    armed: bool = True
    attended: bool = False
    waits: bool = False
    elapsed_s: float | None = field(init=False, default=None)
    phase: Phase = field(init=False, default=Phase.NEW)
    requests: RequestChannel = field(init=False)
    telemetry: Telemetry = field(init=False)
    plans: PlanBuffer = field(init=False)
    targets: TargetMailbox = field(init=False)
    heard_channel: HeardChannel = field(init=False)
    humans: HumanChannel = field(init=False)
    planner: Planner = field(init=False)
    record: RunTrace = field(init=False)
    loop: ControlLoop | None = field(init=False, default=None)
    scheduling: Scheduling = field(init=False, default="other")
    awake: bool = field(init=False, default=False)
    """Whether processors were kept from sleeping in the last run on the real clock."""
    memory_mb: tuple[float, float] | None = field(init=False, default=None)
    _heard: list[Heard] = field(init=False, default_factory=list)
    _hears: Reader = field(init=False)
    _entered: ExitStack = field(init=False)
    _step: Callable[[], bool] | None = field(init=False, default=None)
    _begin_s: float = field(init=False, default=0.0)

    def __post_init__(self) -> None:
        if self.clock not in get_args(Clock):
            raise ConfigError(f"clock: {self.clock!r}, expected one of: {', '.join(get_args(Clock))}")
        if self.seconds is not None and not self.seconds > 0.0:
            raise ConfigError(f"seconds: {self.seconds!r}, expected a positive number or None")
        robot, rate = self.robot, self.robot.rate_hz
        retargeter = Retargeter(robot, self.settings)
        self.requests = RequestChannel()
        self.telemetry = Telemetry(robot.n, rate)
        self.plans = PlanBuffer(robot.n, retargeter.layout.size, retargeter.horizon, rate)
        self.targets = TargetMailbox()
        self.heard_channel = HeardChannel()
        self.humans = HumanChannel()
        self._hears = self.heard_channel.reader()
        self.planner = Planner(retargeter, self.source, self.settings)
        self.record = RunTrace(rate, robot.joint_names, kept_s=max(self.kept_s, (self.seconds or 0.0) + MARGIN_S))

    def __repr__(self) -> str:
        parts = (self.robot.name, self.driver.name, self.source.name, self.clock)
        return f"Session({', '.join(map(repr, parts))}: {self.phase.value})"

    def run(self) -> RunTrace:
        """Run to the end and return the record.

        Raises:
            ConfigError: the clock is lockstep and the driver's time cannot be stepped.
            SessionError: the session has begun already.
            DriverError: the driver failed.
        """
        if self.clock == "lockstep":
            with ExitStack() as ending:
                ending.push(self._begun(bool(self.stay)).__exit__)
                while self.step():
                    pass
            return self.record
        self._begin()
        try:
            return self._run_real()
        finally:
            self._end()

    # ---------------------------------------------------------------- stepped by a program, in lockstep

    def __enter__(self) -> Self:
        """Open the driver and begin a run that `step` and `advance` carry on.

        Raises:
            ConfigError: the clock is not lockstep, or the driver's time cannot be stepped.
            SessionError: the session has begun already.
            DriverError: the driver failed.
        """
        if self.clock != "lockstep":
            raise ConfigError(f"{self!r}: clock {self.clock!r} passes by itself; call run() instead of stepping")
        endless = isinstance(self.source, LiveSource) and self.seconds is None and _length(self.source) is None
        return self._begun(endless if self.stay is None else self.stay)

    def _begun(self, stay: bool) -> Self:
        self._begin()
        self._entered = ExitStack()
        try:
            self._step = self._entered.enter_context(self._stepped(stay))
        except BaseException:
            self._end()
            raise
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """End the services and close the driver: torque is off."""
        self._step = None
        try:
            self._entered.__exit__(kind, error, trace)
        finally:
            self._end()

    def _begin(self) -> None:
        if self.phase is not Phase.NEW:
            raise SessionError(f"{self!r}: a session is run once; open another")
        self.phase, self._begin_s = Phase.RUNNING, time.perf_counter()

    def _end(self) -> None:
        self.phase, self.elapsed_s = Phase.ENDED, time.perf_counter() - self._begin_s

    def step(self) -> bool:
        """Run one tick; returns whether the run goes on.

        Raises:
            SessionError: the session has not been entered (`with session:`), or has been left.
            DriverError: the driver failed.
        """
        if self._step is None:
            raise SessionError(f"{self!r}: steps are taken within its context: with session: session.step()")
        return self._step()

    def advance(self, seconds: float) -> bool:
        """Run as many ticks as `seconds` hold, fewer where the run ends; returns whether it goes on. See `step`.

        Raises:
            ConfigError: less than one tick.
        """
        ticks = round(seconds * self.robot.rate_hz)
        if ticks < 1:
            raise ConfigError(f"seconds: {seconds!r}, expected at least a tick, {1.0 / self.robot.rate_hz:g} s")
        return all(self.step() for _ in range(ticks))

    def finish(self) -> RunTrace:
        """Request the end and step to it: the robot comes to a balanced stop, parks, torque goes off. See `step`."""
        self.ask(Request.END)
        while self.step():
            pass
        return self.record

    # ---------------------------------------------------------------- on either clock

    def send(self, intent: Intent, *, holds_s: float = math.inf) -> Target:
        """Set the target that the robot follows from now on.

        A target that the source cannot follow, a clip for a model say, is refused when it is to be followed, by a note.

        Args:
            intent: what to do.
            holds_s: the robot comes to a stand after this time [s]; infinite: it follows until the next target.

        Raises:
            ConfigError: no intent, the source follows no targets, or the target's text is too long.
            SessionError: the run has ended.
        """
        if not isinstance(intent, Intent):
            raise ConfigError(
                f"target: {intent!r}, expected one of: {', '.join(one.__name__ for one in WORDS.values())}"
            )
        if not isinstance(self.source, LiveSource):
            raise ConfigError(f"{self.source.name}: a source that follows no targets; a model or a clip library does")
        self._require_open()
        return self.targets.send(intent, holds_s=holds_s)

    def ask(self, request: Request) -> None:
        """Request a stop, an emergency stop or the end; it acts on the next tick.

        Raises:
            ValueError: no `Request`.
            SessionError: the run has ended.
        """
        self._require_open()
        self.requests.send(Request(request))

    def _require_open(self) -> None:
        if self.phase is Phase.ENDED:
            raise SessionError(f"{self!r}: nothing acts on it any more")

    @property
    def heard(self) -> list[Heard]:
        """The answers so far, each in its newest version: those to the script or the prompt, then those to targets.

        Of a long run the newest thousand targets are kept.
        """
        source = self.source.source if isinstance(self.source, NoisySource) else self.source
        items = list(source.heard_items) if isinstance(source, ModelSource) else []
        self._listen()
        return merged([*items, *self._heard])

    def _listen(self) -> None:
        """Take the answers that have arrived."""
        new = heard_since(self._hears)
        if new:
            self._heard = merged([*self._heard, *new])[-_HEARD_KEPT:]

    @property
    def state(self) -> SessionState:
        """The newest tick; before the first one with tick -1 and without values (NaN)."""
        row = self.telemetry.ticks.latest()
        if row is None:
            row = blank(TickRow.dtype(joints=self.robot.n))
            row["tick"] = -1
        return SessionState.of(TickRow(row), self.robot.rate_hz)

    def control_loop(self, driver: Driver) -> ControlLoop:
        """The loop of this run."""
        # A retargeter of its own: the planner's works in another process.
        retargeter = Retargeter(self.robot, self.settings)
        return ControlLoop(self.robot, driver, retargeter, self.plans, self.telemetry, feedback=self.feedback)

    def _replanner(self, lead: Lead, on_note: Callable[[str], None]) -> Replanner:
        return Replanner(
            self.planner,
            self.plans,
            self.telemetry.ticks,
            self.settings,
            self.targets,
            lead,
            on_note,
            self.heard_channel,
            self.humans,
            lockstep=self.clock == "lockstep",
        )

    @contextmanager
    def _stepped(self, stay: bool) -> Iterator[Callable[[], bool]]:
        """A lockstep run: each call of the function runs one tick and returns whether the run goes on."""
        driver = lockstep(self.driver)
        if driver is None:
            raise ConfigError(f"driver {self.driver.name!r} runs on the real clock only: clock real")
        period = 1.0 / self.robot.rate_hz
        lead = FixedLead(max(round(self.settings.commit_s * self.robot.rate_hz), 1))
        replanner = self._replanner(lead, partial(self.requests.send, Request.NOTE))
        collector = Collector(self.telemetry, self.record)
        followers = [service.follow() for service in self.services]
        with ExitStack() as ending, driver:
            for follow in followers:
                ending.callback(follow, True)
            loop = self.loop = self.control_loop(driver)
            lifecycle = Lifecycle(
                loop, self.settings, seconds=self.seconds, stay=stay, armed=self.armed, attended=self.attended
            )
            channels = [channel.reader() for channel in (*requests_of(self.services), self.requests)]

            def step() -> bool:
                if lifecycle.finished:
                    return False
                request = None if self.next_request is None else self.next_request()
                if request is not None:
                    lifecycle.request(request)
                for channel in channels:
                    for sent, reason in channel.read():
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
                self._listen()
                for follow in followers:
                    follow(False)
                if self.progress is not None:
                    self.progress(float(self.record.source_s[-1]))
                return not lifecycle.finished

            yield step

    def _listening_request(self) -> Request | None:
        """`next_request`, before which the answers that have arrived are taken."""
        self._listen()
        return None if self.next_request is None else self.next_request()

    def _run_real(self) -> RunTrace:
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
            stay=bool(self.stay),
            armed=self.armed,
            attended=self.attended,
            realtime=self.realtime,
            services=self.services,
            wake=self.wake,
            waits=self.waits,
        )
        collector = Collector(self.telemetry, self.record)
        with awake(self.settings.wake_latency_us if self.realtime else None) as self.awake:
            self.scheduling = supervisor.run(collector, self._listening_request, self.progress, self.on_event)
        self.memory_mb = supervisor.memory_mb
        return self.record


def _length(source: Source) -> float | None:
    """Length of a source [s]; None: without an end."""
    return source.seconds if isinstance(source, Performance) else None
