"""Check of a motion against every servo's torque: at every tick, and thermally."""

from __future__ import annotations

from typing import Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field
from rich.console import Group, RenderableType
from rich.text import Text

from flexmotion.configs.envelope import endurance, torque_limit
from flexmotion.configs.robot import Robot
from flexmotion.streamer.planning.offline import Trajectory
from flexmotion.streamer.report.report import Figure, Maybe
from flexmotion.streamer.report.summary import show, table

MAX_OVER_SHARE = 0.05
"""Largest share of the motion's time in which a joint may need more torque than its servo has."""


class JointTorque(BaseModel):
    """One joint.

    Attributes:
        over_share: share of the time in which the plan needs more torque than the servo has at that speed.
        peak_excess_nm: largest excess over the limit; negative: smallest margin.
        peak_at_s, peak_torque_nm, peak_limit_nm: time, torque and limit of that tick.
        settles_at_c: steady-state temperature of the windings if the motion were repeated indefinitely.
        lasts_s: time until the servo would shut itself down; None: never.
    """

    model_config = ConfigDict(frozen=True)

    over_share: Figure
    peak_excess_nm: Figure
    peak_at_s: Figure
    peak_torque_nm: Figure
    peak_limit_nm: Figure
    rms_torque_nm: Figure
    rms_share_of_stall: Figure
    settles_at_c: Figure
    lasts_s: Maybe


class TorqueCheck(BaseModel):
    """Result of `flexmotion check torque`; `worst` is the joint over its limit for longest, or closest to it."""

    model_config = ConfigDict(frozen=True)

    schema_: Literal["flexmotion.torque/1"] = Field(default="flexmotion.torque/1", alias="schema")
    ok: bool
    robot: str
    source: str
    duration_s: Figure
    worst: str
    joints: dict[str, JointTorque]

    def json_text(self) -> str:
        """The result as JSON, keys in the order of the schema."""
        return self.model_dump_json(by_alias=True, indent=2)


def check_trajectory(trajectory: Trajectory, robot: Robot, source: str) -> TorqueCheck:
    """Compare the planned torque of every joint and tick with its servo's envelope and endurance.

    The check fails if a joint is over its envelope for longer than `MAX_OVER_SHARE` of the time, or if a servo would
    overheat within the motion's length. A peak of a few ticks, as when a foot leaves the floor, costs a degree of
    tracking; a servo that lacks torque for longer does not follow.
    """
    limit = torque_limit(robot, trajectory.torque, trajectory.qd)
    excess = np.abs(trajectory.torque) - limit
    rms = np.sqrt(np.mean(trajectory.torque**2, axis=0))
    joints: dict[str, JointTorque] = {}
    for joint, name in enumerate(robot.joint_names):
        peak = int(np.argmax(excess[:, joint]))
        lasting = endurance(robot, joint, float(rms[joint]))
        joints[name] = JointTorque(
            over_share=float(np.mean(excess[:, joint] > 0)),
            peak_excess_nm=excess[peak, joint],
            peak_at_s=peak / trajectory.rate_hz,
            peak_torque_nm=abs(trajectory.torque[peak, joint]),
            peak_limit_nm=limit[peak, joint],
            rms_torque_nm=rms[joint],
            rms_share_of_stall=rms[joint] / robot.stall_torque[joint],
            settles_at_c=lasting.temperature,
            lasts_s=lasting.seconds,
        )
    overheats = any(load.lasts_s is not None and load.lasts_s < trajectory.duration for load in joints.values())
    worst = max(joints, key=lambda name: (joints[name].over_share, joints[name].peak_excess_nm))
    return TorqueCheck(
        ok=joints[worst].over_share <= MAX_OVER_SHARE and not overheats,
        robot=robot.name,
        source=source,
        duration_s=trajectory.duration,
        worst=worst,
        joints=joints,
    )


def render_check(check: TorqueCheck) -> RenderableType:
    """The result for a terminal: the verdict, then every joint, the closest to its limit first."""
    worst = check.joints[check.worst]
    peak = f"{worst.peak_torque_nm:.2f} of {worst.peak_limit_nm:.2f} N·m"
    verdict = (
        f"{check.robot}, {check.source}, {check.duration_s:.1f} s: {check.worst} needs more than its servo has for "
        f"{100 * worst.over_share:.1f} % of the time ({100 * MAX_OVER_SHARE:.0f} % allowed), worst at "
        f"{worst.peak_at_s:.2f} s ({peak})"
    )
    mark = Text("PASS ", style="bold green") if check.ok else Text("FAIL ", style="bold red")
    drawn = table("", "joint", "worst", "servo has", "at", "over", "rms", "of stall", "settles at", "lasts")
    for name, load in sorted(check.joints.items(), key=lambda item: (-item[1].over_share, -item[1].peak_excess_nm)):
        drawn.add_row(
            name,
            show(load.peak_torque_nm, "N·m", 1, 2),
            show(load.peak_limit_nm, "N·m", 1, 2),
            show(load.peak_at_s, "s", 1, 2),
            show(load.over_share, "%", 100, 1),
            show(load.rms_torque_nm, "N·m", 1, 2),
            show(load.rms_share_of_stall, "%", 100, 0),
            show(load.settles_at_c, "°C", 1, 0),
            "no limit" if load.lasts_s is None else show(load.lasts_s, "min", 1 / 60, 1),
            style="bold red" if load.over_share > MAX_OVER_SHARE else "",
        )
    note = (
        "torque as planned, balance feedback not included; torque over the limit is clamped in a run, and the joint "
        "lags behind its plan; temperatures from the servo catalogue's thermal constants"
    )
    return Group(mark + Text(verdict, style="bold"), Text(), drawn, Text(note, style="dim"))
