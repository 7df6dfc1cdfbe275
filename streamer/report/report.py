"""The report of a run, `flexmotion.report/1`: its request, its figures and its verdict.

Two lockstep runs with the same clip, seed and options give the same bytes except for `TIMING_KEYS`.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, Literal

import numpy as np
from pydantic import Field

from flexmotion.streamer.control.ladder import State
from flexmotion.streamer.control.run_totals import Times, TorqueSource
from flexmotion.streamer.control.run_trace import RunTrace
from flexmotion.streamer.motion.heard import Heard, not_done
from flexmotion.streamer.planning.ease_notes import EASED, REFUSED
from flexmotion.streamer.report.figure import Figure, Maybe, Section
from flexmotion.streamer.report.human_sections import LikenessSection, TorqueProfileSection
from flexmotion.streamer.report.likeness import Likeness
from flexmotion.streamer.report.metrics import HumanTrack, RobotFigures, joint_loads, motion_figures
from flexmotion.streamer.report.torque_profile import TorqueProfile
from flexmotion.text.phrases import STAND

TIMING_KEYS = ("loop", "planner", "log")
"""Top-level keys that may differ between equal runs."""

CutBy = Literal["interrupt", "seconds"]
"""What ended a run before all that was asked was done: a signal, or `--seconds`."""

_ENDS, _STOPS = ("END", "QUIT"), ("STOP", "ESTOP", "KILL", "DISARM")
"""Requests that end the run, and that stop the robot."""
_LAST_FRAME_S = 0.1
"""The last frame that is played is at most this long before the end of a script [s]."""


class Latency(Section):
    """Percentiles of a time; its key names the unit."""

    p50: Figure
    p95: Figure
    p99: Figure
    p99_9: Figure
    max: Figure

    @classmethod
    def of(cls, seconds: Iterable[float], unit_s: float) -> Latency | None:
        """Percentiles of the finite times in units of `unit_s`; None without any."""
        values = np.asarray(list(seconds), dtype=float)
        values = values[np.isfinite(values)] / unit_s
        if not len(values):
            return None
        p50, p95, p99, p99_9 = np.percentile(values, (50, 95, 99, 99.9))
        return cls(p50=p50, p95=p95, p99=p99, p99_9=p99_9, max=values.max())

    @classmethod
    def of_run(cls, record: RunTrace, name: str, unit_s: float) -> Latency | None:
        """Percentiles of a time of a whole run; see `RunTrace.times`."""
        times = record.times(name)
        if not isinstance(times, Times):
            return cls.of(times, unit_s)
        if not times.count:
            return None
        p50, p95, p99, p99_9 = (times.percentile(percent) / unit_s for percent in (50, 95, 99, 99.9))
        return cls(p50=p50, p95=p95, p99=p99, p99_9=p99_9, max=times.most / unit_s)


class LoopSection(Section):
    """Timing of the control loop. `realtime_factor` is the run's duration over its wall-clock time."""

    rate_hz: Figure
    cycles: int
    missed_deadlines: int
    missed_allowed: int
    wake_lateness_us: Latency | None
    work_us: Latency | None
    realtime: Literal["fifo", "other"]
    robot_lateness_us: Latency | None
    elapsed_s: Maybe
    realtime_factor: Maybe


class PlannerSection(Section):
    """Computing time of plans, latency from targets to commands, and what was told of motion that had to be eased."""

    plans: int
    sample_ms: Latency | None
    retarget_ms: Latency | None
    target_to_command_ms: Latency | None
    target_to_effect_ms: Latency | None
    underruns: int
    eased: tuple[str, ...] = ()

    @property
    def refusals(self) -> tuple[str, ...]:
        """Motion that was refused because no slower or smaller one is within the envelope, in words."""
        return tuple(message for message in self.eased if REFUSED in message)


class DisplacementSection(Section):
    """Net displacement; see `flexmotion.streamer.report.metrics.Displacement`."""

    ahead_m: Figure
    left_m: Figure
    turned_rad: Figure


class MotionSection(Section):
    """How the robot moved; see `flexmotion.streamer.report.metrics.MotionFigures`; and the count of steps.

    `fell`, `time_to_fall_s` and counts of steps are of the whole run, the other figures from
    `period_begin_s` to `period_end_s` [s of the run].
    """

    fell: bool
    time_to_fall_s: Maybe
    period_begin_s: Figure
    period_end_s: Figure
    joint_rmse_rad: Maybe
    lag_s: Maybe
    foot_slip_mm_s: Maybe
    net_path_ratio: Maybe
    robot_went: DisplacementSection | None
    human_went: DisplacementSection | None
    behind_m: Maybe
    heading_rms_rad: Maybe
    human_steps: int | None
    steps_planned: int
    steps_inserted: int
    steps_dropped: int | None
    hand_error_share: Maybe
    limb_stiffness: Maybe
    self_collisions: int | None


class JointSection(Section):
    """Load of one joint and its limits; see `flexmotion.streamer.report.metrics.JointLoad`."""

    peak_torque_nm: Maybe
    rms_torque_nm: Maybe
    torque_limit_nm: Figure
    rms_share_of_stall: Maybe
    peak_speed_rad_s: Maybe
    speed_limit_rad_s: Figure
    saturated_share: Maybe


class LimitsSection(Section):
    """Limits that were reached, and loads of the joints.

    `violations_sent` counts goals outside a servo's envelope that left the loop: a simulated robot has received them,
    on a bus positions among them were held back. Repairs are counted in planner and loop. `torque_source` is the
    source of the joints' torques; None if they are unknown.
    """

    violations_sent: int
    repairs: dict[str, int]
    torque_source: TorqueSource | None
    joints: dict[str, JointSection]


class SafetySection(Section):
    """Final state of the safety ladder, all faults, and whether the hardware caused them."""

    final_state: str
    faults: list[str]
    hardware_failed: bool = False


class Report(Section):
    """The whole report; keys are a contract (see `docs/report.md`)."""

    schema_: Literal["flexmotion.report/1"] = Field(default="flexmotion.report/1", alias="schema")
    ok: bool
    robot: str
    driver: str
    source: str
    seed: int
    duration_s: Figure
    clock: Literal["real", "lockstep"]
    options: dict[str, Any]
    loop: LoopSection
    planner: PlannerSection
    motion: MotionSection
    likeness: LikenessSection | None = None
    limits: LimitsSection
    torque_profile: TorqueProfileSection | None = None
    safety: SafetySection
    targets: tuple[Heard, ...] = ()
    cut_by: CutBy | None = None
    log: str | None

    def json_text(self) -> str:
        """The report as JSON, keys in the order of the schema, with a final newline."""
        return self.model_dump_json(by_alias=True, indent=2) + "\n"

    def write(self, folder: Path) -> Path:
        """Write `report.json` into `folder`, which is made if missing; returns its path."""
        folder.mkdir(parents=True, exist_ok=True)
        file = folder / "report.json"
        file.write_text(self.json_text(), encoding="utf-8")
        return file


@dataclass(frozen=True)
class RunInfo:
    """The request and the conditions of a run; the rest of the report comes from the record.

    Attributes:
        robot, driver, source: names; the source is a file name or `model:NAME`.
        seed: of all random numbers.
        clock: "real" or "lockstep".
        options: other settings by name, such as perturbations.
        elapsed_s: wall-clock time of the run [s].
        realtime: scheduling class of the loop.
        missed_allowed, underruns_allowed: missed deadlines and underruns that are allowed.
        log: path of the log; None without one.
        targets: the answers to all that was asked.
        ends_itself: whether the run has an end of its own; who ends it before interrupts it.
        allow_refused: the run is ok although something that was asked was refused, dropped or not finished.
        min_likeness: the run is not ok below this likeness, in [0, 1], or where it is not known; None: not judged.
    """

    robot: str
    driver: str
    source: str
    seed: int = 0
    clock: Literal["real", "lockstep"] = "lockstep"
    options: dict[str, Any] = field(default_factory=dict)
    elapsed_s: float | None = None
    realtime: Literal["fifo", "other"] = "other"
    missed_allowed: int = 0
    underruns_allowed: int = 0
    log: str | None = None
    targets: tuple[Heard, ...] = ()
    ends_itself: bool = False
    allow_refused: bool = False
    min_likeness: float | None = None


def _dropped(record: RunTrace) -> int | None:
    """Footsteps of the human that the planner left out; None where those of the human are not known."""
    if record.human_steps is None:
        return None
    return max(record.human_steps - (record.steps_planned - record.steps_inserted), 0)


def _reached(record: RunTrace, answers: tuple[Heard, ...]) -> tuple[Heard, ...]:
    """The answers; those to items of a script whose time never came say so."""
    until_s = float(np.nanmax(record.source_s, initial=-np.inf))
    stood_until_s = _stood_until_s(record)
    return tuple(
        heard.model_copy(update={"reached": False})
        if heard.item is not None
        and heard.state != "refused"
        and (heard.at_s or 0.0) > (max(until_s, stood_until_s) if heard.heard_as == STAND else until_s) + _LAST_FRAME_S
        and all(step.end is None for step in heard.steps)
        else heard
        for heard in answers
    )


def _stood_until_s(record: RunTrace) -> float:
    """Until when the robot stood and waited, in the script's time [s]; -inf: it never did.

    A source is not played on while the robot stands, so its own time does not tell; a stand asks nothing more of it.
    """
    played = np.flatnonzero(np.isfinite(record.source_s))
    stood = np.flatnonzero(record.state[: record.used] == State.HOLD)
    if not len(played) or not len(stood):
        return -np.inf
    ticks = int(record.tick[stood[-1]]) - int(record.tick[played[0]])
    return float(record.source_s[played[0]]) + ticks / record.rate_hz


def _cut_by(record: RunTrace, info: RunInfo, answers: tuple[Heard, ...], faults: list[str]) -> CutBy | None:
    """What ended the run before all that was asked was done; None: nothing, or a fault or an operator's stop."""
    parked = np.flatnonzero(record.state == State.PARK)
    until = int(record.tick[parked[0]]) if len(parked) else np.inf
    asked = {event.message for event in record.events if event.kind == "request" and event.tick <= until}
    if info.ends_itself and not asked.isdisjoint(_ENDS):
        return "interrupt"
    stopped = faults or not asked.isdisjoint((*_ENDS, *_STOPS))
    cut = any(heard.failure is None for heard, _ in not_done(answers))
    return "seconds" if info.ends_itself and cut and not stopped else None


def build_report(
    record: RunTrace,
    info: RunInfo,
    robot: RobotFigures,
    *,
    human: HumanTrack | None = None,
    likeness: Likeness | None = None,
    profile: TorqueProfile | None = None,
) -> Report:
    """The report of a finished run.

    Args:
        human: the human's path; None if unknown.
        likeness: how much of the human's motion the robot did; None if unknown.
        profile: the human's torques beside the robot's; None if unknown.
    """
    states = record.state[: record.used]
    duration = record.duration_s
    planner = PlannerSection(
        plans=record.plans_played,
        sample_ms=Latency.of_run(record, "sample_s", 1e-3),
        retarget_ms=Latency.of_run(record, "retarget_s", 1e-3),
        target_to_command_ms=Latency.of_run(record, "target_to_command_s", 1e-3),
        target_to_effect_ms=Latency.of_run(record, "target_to_effect_s", 1e-3),
        underruns=record.underruns,
        eased=tuple(event.message for event in record.events if event.kind == "note" and EASED in event.message),
    )
    figures = motion_figures(record, robot, human, should_stand=np.isin(states, (State.STREAMING, State.HOLD)))
    motion = asdict(figures)
    if not figures.fell and (damped := np.flatnonzero(states == State.DAMPED)).size:
        # Without ground truth the loop's own fall detection counts, the only cause of DAMPED.
        motion |= {"fell": True, "time_to_fall_s": int(record.tick[damped[0]]) / record.rate_hz}
    elif figures.time_to_fall_s is not None:
        motion["time_to_fall_s"] = figures.time_to_fall_s + record.period_s[0]
    if record.totals.fall_tick is not None:
        motion |= {"fell": True, "time_to_fall_s": record.totals.fall_tick / record.rate_hz}
    targets = _reached(record, info.targets)
    faults = [event.message for event in record.events if event.kind == "fault"]
    cut_by = _cut_by(record, info, targets, faults)
    return Report(
        ok=(
            not motion["fell"]
            and not faults
            and cut_by != "interrupt"
            and record.violations_sent == 0
            and record.missed_deadlines <= info.missed_allowed
            and record.underruns <= info.underruns_allowed
            and (record.totals.streamed or bool((states == State.STREAMING).any()))
            and states[-1] in (State.HOLD, State.OFF)
            and (info.allow_refused or not (planner.refusals or not_done(targets)))
            and (info.min_likeness is None or (likeness is not None and likeness.score >= info.min_likeness))
        ),
        robot=info.robot,
        driver=info.driver,
        source=info.source,
        seed=info.seed,
        duration_s=duration,
        clock=info.clock,
        options=info.options,
        loop=LoopSection(
            rate_hz=record.rate_hz,
            cycles=record.cycles,
            missed_deadlines=record.missed_deadlines,
            missed_allowed=info.missed_allowed,
            # In lockstep the loop does not sleep.
            wake_lateness_us=Latency.of_run(record, "lateness_s", 1e-6) if info.clock == "real" else None,
            work_us=Latency.of_run(record, "work_s", 1e-6),
            realtime=info.realtime,
            robot_lateness_us=Latency.of_run(record, "robot_lateness_s", 1e-6),
            elapsed_s=info.elapsed_s,
            realtime_factor=duration / info.elapsed_s if info.elapsed_s else None,
        ),
        planner=planner,
        motion=MotionSection(
            **motion,
            period_begin_s=record.period_s[0],
            period_end_s=record.period_s[1],
            human_steps=record.human_steps,
            steps_planned=record.steps_planned,
            steps_inserted=record.steps_inserted,
            steps_dropped=_dropped(record),
        ),
        likeness=None if likeness is None else LikenessSection.of(likeness, figures),
        limits=LimitsSection(
            violations_sent=record.violations_sent,
            repairs=dict(record.repairs),
            torque_source=record.torque_source,
            joints={name: JointSection(**asdict(load)) for name, load in joint_loads(record, robot).items()},
        ),
        torque_profile=None if profile is None else TorqueProfileSection.of(profile),
        safety=SafetySection(
            final_state=State(states[-1]).name if len(states) else State.OFF.name,
            faults=faults,
            hardware_failed=record.hardware_failed,
        ),
        targets=targets,
        cut_by=cut_by,
        log=info.log,
    )
