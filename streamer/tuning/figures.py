"""`RunFigures`: how well a robot followed one motion, and means over several."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import Self

from flexmotion.streamer.outcome import Outcome
from flexmotion.streamer.report.figure import Figure, Maybe, Section
from flexmotion.streamer.report.report import Report


class AskedWay(Section):
    """The way of a human at its own pace, not slowed for any robot.

    Attributes:
        way_m: straight distance from start to end [m]; None where the human stays in its place, or turns: a straight
            distance says nothing about an arc.
    """

    way_m: Maybe


class RunFigures(Section):
    """How well a robot followed one motion. Units are in the names; None where unknown, or where it does not occur.

    Attributes:
        upright: whether it did not fall, had no fault and sent no goal outside a servo's envelope.
        lasted: share of the run until it fell, in [0, 1]; 1 where it did not fall.
        way_share: straight distance of the robot over the asked one, scaled to its legs [1].
        heading_deg: RMS difference of its heading from that of the human as played.
        arm_deg, trunk_deg: mean angle between a segment of the human and that of the robot, as of
            `flexmotion.streamer.report.likeness`.
        heat: greatest RMS torque of a servo over its stall torque [1]; its motor's heat goes with the square.
        failure: why there was no run; None: there was one.
    """

    clip: str
    kind: str
    perturbed: bool
    upright: bool
    lasted: Figure
    way_share: Maybe = None
    heading_deg: Maybe = None
    arm_deg: Maybe = None
    trunk_deg: Maybe = None
    heat: Maybe = None
    failure: str | None = None

    @classmethod
    def of(cls, clip: str, kind: str, perturbed: bool, outcome: Outcome, asked: AskedWay) -> Self:
        """The figures of a finished run."""
        report, motion = outcome.report, outcome.report.motion
        went, like = motion.robot_went, report.likeness
        way = None
        if went is not None and asked.way_m is not None:
            way = math.hypot(went.ahead_m, went.left_m) / (asked.way_m * outcome.figures.leg_ratio)
        loads = [load.rms_share_of_stall for load in report.limits.joints.values()]
        return cls(
            clip=clip,
            kind=kind,
            perturbed=perturbed,
            upright=stayed_up(report),
            lasted=1.0 if motion.time_to_fall_s is None else min(motion.time_to_fall_s / report.duration_s, 1.0),
            way_share=way,
            heading_deg=None if motion.heading_rms_rad is None else math.degrees(motion.heading_rms_rad),
            arm_deg=None if like is None else like.arm_direction_deg,
            trunk_deg=None if like is None else like.trunk_deg,
            heat=max((load for load in loads if load is not None), default=None),
        )

    @classmethod
    def failed(cls, clip: str, kind: str, perturbed: bool, failure: str) -> Self:
        """The figures of a robot that could not run at all: those of a fall at the start."""
        return cls(clip=clip, kind=kind, perturbed=perturbed, upright=False, lasted=0.0, failure=failure)


class MeanFigures(Section):
    """Figures of several runs: counts of all, means over those that stayed upright."""

    runs: int
    upright: int
    way_share: Maybe
    heading_deg: Maybe
    arm_deg: Maybe
    trunk_deg: Maybe
    heat: Maybe

    @classmethod
    def of(cls, runs: Sequence[RunFigures]) -> Self:
        """Of at least one run."""
        up = [run for run in runs if run.upright]
        return cls(
            runs=len(runs),
            upright=len(up),
            way_share=_mean(run.way_share for run in up),
            heading_deg=_mean(run.heading_deg for run in up),
            arm_deg=_mean(run.arm_deg for run in up),
            trunk_deg=_mean(run.trunk_deg for run in up),
            heat=_mean(run.heat for run in up),
        )


def stayed_up(report: Report) -> bool:
    """Whether a run neither fell nor ended by a fault, and sent no goal outside a servo's envelope."""
    return not report.motion.fell and not report.safety.faults and report.limits.violations_sent == 0


def _mean(values: Iterable[float | None]) -> float | None:
    known = [value for value in values if value is not None]
    return sum(known) / len(known) if known else None
