"""A whole run: robot up, source streamed, robot parked; on a clock that steps (lockstep) or one that passes (real)."""

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

    def __post_init__(self) -> None:
        robot, rate = self.robot, self.robot.rate_hz
        retargeter = Retargeter(robot, self.settings)
        self.controls = RequestChannel()
        self.telemetry = Telemetry(robot.n, rate)
        self.plans = PlanBuffer(robot.n, retargeter.layout.size, retargeter.horizon, rate)
        self.targets = TargetMailbox()
        self.planner = Planner(retargeter, self.source, self.settings)
        self.record = RunTrace(rate, robot.joint_names, kept_s=max(self.kept_s, (self.seconds or 0.0) + MARGIN_S))

    def run(self, clock: str = "lockstep") -> RunTrace:
        """Run to the end on clock "lockstep" or "real" and return the record.

        Raises:
            ConfigError: lockstep is asked for with a driver whose time cannot be stepped.
            DriverError: the driver failed.
        """
        if clock == "real":
            return self._run_real()
        if not self.driver.capabilities.lockstep:
            raise ConfigError(f"driver {self.driver.name!r} runs on the real clock only; use --clock real")
        return self._run_lockstep()

    def control_loop(self, driver: Driver) -> ControlLoop:
        """The loop of this run."""
        # A retargeter of its own: the planner's works in another process.
        retargeter = Retargeter(self.robot, self.settings)
        return ControlLoop(self.robot, driver, retargeter, self.plans, self.telemetry, feedback=self.feedback)

    def _planning(self, lead: Lead, tell: Callable[[str], None]) -> Replanner:
        return Replanner(self.planner, self.plans, self.telemetry.ticks, self.settings, self.targets, lead, tell)

    def _run_lockstep(self) -> RunTrace:
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
            while not lifecycle.finished:
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
        return self.record

    def _run_real(self) -> RunTrace:
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
    return count_steps(motion)
