"""Quality of a retargeted motion, before a robot runs it."""

from __future__ import annotations

from typing import Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field
from rich.console import Group, RenderableType
from rich.text import Text

from flexmotion.configs.envelope import Envelope
from flexmotion.configs.robot import Robot
from flexmotion.human.motion import Motion
from flexmotion.spatial.heading import continuous_heading
from flexmotion.streamer.planning.offline import Trajectory
from flexmotion.streamer.report.figure import Figure, Maybe
from flexmotion.streamer.report.metrics import (
    Displacement,
    HumanTrack,
    RobotFigures,
    hand_error_share,
    heading_rms,
    net_path_ratio,
)
from flexmotion.streamer.report.report import Latency
from flexmotion.streamer.report.summary import show, steps_words, table


class Worst(BaseModel):
    """The joint that comes closest to a limit: its share of the limit, and when."""

    model_config = ConfigDict(frozen=True)

    joint: str
    share: Figure
    at_s: Figure


class Quality(BaseModel):
    """Report of `flexmotion retarget`: the figures of a run's report, for the plan instead of the robot."""

    model_config = ConfigDict(frozen=True)

    schema_: Literal["flexmotion.retarget/1"] = Field(default="flexmotion.retarget/1", alias="schema")
    robot: str
    source: str
    duration_s: Figure
    rate_hz: Figure
    net_path_ratio: Maybe
    heading_rms_rad: Maybe
    hand_error_share: Maybe
    human_steps: int
    steps_planned: int
    steps_inserted: int
    steps_dropped: int
    repairs: dict[str, int]
    torque: Worst
    speed: Worst
    retarget_ms: Latency | None

    def json_text(self) -> str:
        """The report as JSON, keys in the order of the schema."""
        return self.model_dump_json(by_alias=True, indent=2)


def quality(trajectory: Trajectory, robot: Robot, motion: Motion) -> Quality:
    """Compare a trajectory with the motion that it was made from."""
    figures = RobotFigures.of(robot, motion.body.leg)
    following = np.isfinite(trajectory.source_s)
    base = trajectory.base[following]
    # The robot's path ends where it comes to a stand (as in `metrics.motion_figures`).
    path = trajectory.base[int(np.flatnonzero(following)[0]) :]
    human_position, human_heading = HumanTrack.of(motion).at(trajectory.source_s[following])
    return Quality(
        robot=robot.name,
        source=motion.source,
        duration_s=trajectory.duration,
        rate_hz=trajectory.rate_hz,
        net_path_ratio=net_path_ratio(
            Displacement.of(path, continuous_heading(path[:, 3:])),
            Displacement.of(human_position, human_heading, figures.leg_ratio),
            figures.leg_ratio,
        ),
        heading_rms_rad=heading_rms(continuous_heading(base[:, 3:]), human_heading),
        hand_error_share=hand_error_share(trajectory.hand_error[following], figures.arm_length),
        human_steps=trajectory.human_steps,
        steps_planned=trajectory.steps,
        steps_inserted=trajectory.inserted,
        steps_dropped=trajectory.dropped,
        repairs=trajectory.repairs,
        torque=_worst(trajectory, robot, Envelope.of(robot).load(trajectory.torque, trajectory.qd)),
        speed=_worst(trajectory, robot, trajectory.qd / robot.no_load_speed),
        retarget_ms=Latency.of(trajectory.retarget_s, 1e-3),
    )


def render_quality(result: Quality) -> RenderableType:
    """The quality report for a terminal."""
    rows = [
        ("net path", show(result.net_path_ratio, "", 1, 2), "planned over human, scaled by leg length"),
        ("heading error", show(result.heading_rms_rad, "°", 180 / np.pi, 1), "RMS, plan against human"),
        ("hand error", show(result.hand_error_share, "%", 100, 1), "median, of arm length, where within reach"),
        (
            "steps",
            str(result.steps_planned),
            steps_words(result.steps_planned, result.steps_inserted, result.human_steps, result.steps_dropped),
        ),
        ("torque", show(result.torque.share, "%", 100, 0), f"of the servo's envelope at most: {_where(result.torque)}"),
        ("speed", show(result.speed.share, "%", 100, 0), f"of no-load speed at most: {_where(result.speed)}"),
        ("repairs", str(sum(result.repairs.values())), ", ".join(f"{n} {kind}" for kind, n in result.repairs.items())),
    ]
    if result.retarget_ms is not None:
        rows.append(("retargeting", show(result.retarget_ms.p50, "ms"), f"a plan; p99 {result.retarget_ms.p99:.3g} ms"))
    drawn = table("", "", "", "")
    for name, value, meaning in rows:
        drawn.add_row(name, value, Text(meaning, style="dim"))
    return Group(Text(f"{result.source} on {result.robot}, {result.duration_s:.1f} s", style="bold"), drawn)


def _where(worst: Worst) -> str:
    return f"{worst.joint} at {worst.at_s:.2f} s"


def _worst(trajectory: Trajectory, robot: Robot, share: np.ndarray) -> Worst:
    tick, joint = np.unravel_index(int(np.argmax(np.abs(share))), share.shape)
    return Worst(
        joint=robot.joint_names[joint], share=abs(float(share[tick, joint])), at_s=float(tick) / trajectory.rate_hz
    )
