"""`RunParts`: what a run is made of: robot, driver, source, settings, and the memory that its processes share."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Literal, get_args

from flexmotion.configs.errors import ConfigError
from flexmotion.configs.robot import Robot
from flexmotion.configs.stream import StreamSettings
from flexmotion.drivers.interface import Driver
from flexmotion.drivers.realtime.priority import Scheduling
from flexmotion.retarget.retargeter import Retargeter
from flexmotion.streamer.control.loop import ControlLoop
from flexmotion.streamer.control.plan_buffer import PlanBuffer
from flexmotion.streamer.control.run_trace import KEPT_S, RunTrace
from flexmotion.streamer.control.telemetry import Event, Telemetry
from flexmotion.streamer.motion.heard import HeardChannel
from flexmotion.streamer.motion.human_channel import HumanChannel
from flexmotion.streamer.motion.mirror_source import MirrorSource
from flexmotion.streamer.motion.sources import Source
from flexmotion.streamer.motion.targets import TargetMailbox
from flexmotion.streamer.planning.lead import Lead
from flexmotion.streamer.planning.planner import Planner
from flexmotion.streamer.planning.replanning import Replanner
from flexmotion.streamer.run.answers import Answers
from flexmotion.streamer.run.lifecycle import MARGIN_S
from flexmotion.streamer.run.requests import Request, RequestChannel
from flexmotion.streamer.run.supervisor import Service

Clock = Literal["real", "lockstep"]


@dataclass(eq=False, repr=False)
class RunParts:
    """One robot, one source, and how it is to run.

    Args:
        seconds: how much of the source is streamed at most [s]; None: all of it.
        feedback: whether balance feedback acts.
        stay: keep standing after the source has ended, until END is requested. None: only where a program steps the run
            and its source follows targets without an end. Once the run has begun it says which.
        realtime: on the real clock: ask the system for realtime scheduling.
        progress: called each tick with the time of the source that plays [s].
        next_request: called before each tick (on the real clock every 20 ms) for an operator's request; None: none. It
            may read `state` and `send` targets.
        wake: file descriptor that becomes readable when `next_request` should be called sooner.
        on_event: called with every event as it happens.
        kept_s: the record keeps at most this much of the run, its end, and at least half of it [s].
        services: recorder, viewer and the like; on the real clock each runs in a process of its own.
        seed: of the driver and the source, for the log and the report.
        clock: "lockstep" or "real".
        allow_refused: for the report: what was refused or dropped does not make it fail.
        min_likeness: for the report: it fails below this likeness; None: not judged.
        armed: torque goes on with the first tick; else with the request ARM.
        attended: the run goes on in OFF and in FAULT until END: CLEAR and ARM lead back to READY.
        waits: on the real clock, a robot that is not there is waited for; else it is an error.

    Attributes:
        answers: what the run has heard.
        requests: of the program that runs it. A signal handler does not use them: it may interrupt one that is sent.
        loop: of a run in lockstep; None: the loop has a process of its own.
        scheduling, memory_mb: of the loop's process in a run on the real clock.
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
    min_likeness: float | None = None
    armed: bool = True
    attended: bool = False
    waits: bool = False
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
    answers: Answers = field(init=False)

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
        self.answers = Answers(self.heard_channel, self.source)
        self.planner = Planner(retargeter, self.source, self.settings)
        self.record = RunTrace(rate, robot.joint_names, kept_s=max(self.kept_s, (self.seconds or 0.0) + MARGIN_S))

    @property
    def patient(self) -> bool:
        """Whether the source may have nothing to follow for any time."""
        return isinstance(self.source, MirrorSource)

    def control_loop(self, driver: Driver) -> ControlLoop:
        """The loop of this run."""
        # A retargeter of its own: the planner's works in another process.
        retargeter = Retargeter(self.robot, self.settings)
        return ControlLoop(self.robot, driver, retargeter, self.plans, self.telemetry, feedback=self.feedback)

    def replanner(self, lead: Lead, on_note: Callable[[str], None]) -> Replanner:
        """The planner's side of this run; see `flexmotion.streamer.planning.replanning.Replanner`."""
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
            turns=self.driver.turns,
        )
