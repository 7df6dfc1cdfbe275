"""`Session`: one run of a robot that follows a source with given settings, in lockstep or on the real clock.

`flexmotion.streamer.run.lifecycle.Lifecycle` is the robot's course through it: start, stream, settle, park.
`flexmotion.streamer.run.supervisor.Supervisor` starts and checks its processes on the real clock.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass, field
from functools import partial

import numpy as np

from flexmotion.configs.errors import ConfigError, FlexMotionError
from flexmotion.configs.robot import Robot
from flexmotion.configs.stream import StreamSettings
from flexmotion.drivers.interface import Driver
from flexmotion.drivers.realtime.priority import Scheduling, awake
from flexmotion.drivers.simulated import LockstepDriver, lockstep
from flexmotion.human.motion import Motion
from flexmotion.retarget.human_steps import count_steps
from flexmotion.retarget.retargeter import Retargeter
from flexmotion.streamer.control.loop import ControlLoop
from flexmotion.streamer.control.plan_buffer import PlanBuffer
from flexmotion.streamer.control.run_trace import KEPT_S, Collector, RunTrace
from flexmotion.streamer.control.telemetry import Event, Telemetry
from flexmotion.streamer.motion.replan_noise import NoisySource
from flexmotion.streamer.motion.sources import LiveSource, Performance, Source
from flexmotion.streamer.motion.targets import TargetMailbox
from flexmotion.streamer.planning.lead import FixedLead, Kind, Lead, MeasuredLead
from flexmotion.streamer.planning.planner import Planner
from flexmotion.streamer.planning.replanning import Replanner
from flexmotion.streamer.run.lifecycle import MARGIN_S, Lifecycle
from flexmotion.streamer.run.requests import Request, RequestChannel
from flexmotion.streamer.run.supervisor import Service, Supervisor

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

    Attributes:
        requests: for requests from this process that must act on the next tick; a signal handler may use it.
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

    def __post_init__(self) -> None:
        robot, rate = self.robot, self.robot.rate_hz
        retargeter = Retargeter(robot, self.settings)
        self.requests = RequestChannel()
        self.telemetry = Telemetry(robot.n, rate)
        self.plans = PlanBuffer(robot.n, retargeter.layout.size, retargeter.horizon, rate)
        self.targets = TargetMailbox()
        self.planner = Planner(retargeter, self.source, self.settings)
        self.record = RunTrace(rate, robot.joint_names, kept_s=max(self.kept_s, (self.seconds or 0.0) + MARGIN_S))

    def run(self, clock: str = "lockstep") -> RunTrace:
        """Run to the end on clock "lockstep" or "real" and return the record.

        Raises:
            ConfigError: the clock is lockstep and the driver's time cannot be stepped.
            DriverError: the driver failed.
        """
        if clock == "real":
            return self._run_real()
        stepped = lockstep(self.driver)
        if stepped is None:
            raise ConfigError(f"driver {self.driver.name!r} runs on the real clock only; use --clock real")
        return self._run_lockstep(stepped)

    def control_loop(self, driver: Driver) -> ControlLoop:
        """The loop of this run."""
        # A retargeter of its own: the planner's works in another process.
        retargeter = Retargeter(self.robot, self.settings)
        return ControlLoop(self.robot, driver, retargeter, self.plans, self.telemetry, feedback=self.feedback)

    def _replanner(self, lead: Lead, on_note: Callable[[str], None]) -> Replanner:
        return Replanner(self.planner, self.plans, self.telemetry.ticks, self.settings, self.targets, lead, on_note)

    def _run_lockstep(self, driver: LockstepDriver) -> RunTrace:
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
            while not lifecycle.finished:
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
        return self.record

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


def human_motion(source: Source, record: RunTrace) -> Motion | None:
    """What the human did in a run, as far as it was played.

    Returns:
        None where that is not known: the source followed targets, or the run is longer than a record keeps.
    """
    if isinstance(source, NoisySource):
        return human_motion(source.source, record)
    if not isinstance(source, Performance):
        return None
    if not isinstance(source, LiveSource):
        return source.human()
    played = record.source_s[record.source_s >= 0.0]
    if not len(played) or played[-1] > KEPT_S or record.ticks.target.any():
        return None
    return source.cut(min(float(played[-1]) + 1.0 / source.fps, source.seconds or np.inf)).human()


def count_human_steps(motion: Motion, retargeter: Retargeter) -> int:
    """Steps that the human makes in a motion, by the measure of the footstep planner."""
    return count_steps(motion)
