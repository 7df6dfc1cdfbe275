"""The result of `flexmotion check torque` in words."""

from __future__ import annotations

import math

from rich.console import Group, RenderableType
from rich.text import Text

from flexmotion.streamer.checks.torque_check import HEAT_S, JointTorque, TorqueCheck
from flexmotion.streamer.report.summary import show, table

FAILURES_SHOWN = 6
"""Joints whose failure is told in words; the others are in the table."""


def render_check(check: TorqueCheck) -> RenderableType:
    """The result for a terminal: the verdict, what failed in words, then every joint, the worst first."""
    mark = Text("PASS ", style="bold green") if check.ok else Text("FAIL ", style="bold red")
    parts: list[RenderableType] = [mark + Text(_verdict(check), style="bold")]
    for name in check.failed[:FAILURES_SHOWN]:
        parts.append(Text(f"  {name}: {_failure(check, check.joints[name])}", style="red"))
    if len(check.failed) > FAILURES_SHOWN:
        parts.append(Text(f"  and {len(check.failed) - FAILURES_SHOWN} more, in the table", style="red"))
    drawn = table(
        "", "joint", "peak", "servo has", "at", "outside", "lag", "rms", "of stall", "10 min", "lasts", "duty"
    )
    order = sorted(check.joints.items(), key=lambda item: (item[1].ok, -item[1].lag_rad, -item[1].peak_load))
    for name, load in order:
        drawn.add_row(
            name,
            show(load.peak_torque_nm, "N·m", 1, 2),
            show(load.peak_limit_nm, "N·m", 1, 2),
            show(load.peak_at_s, "s", 1, 2),
            show(load.over_s, "s", 1, 2),
            show(load.lag_rad, "°", math.degrees(1), 1),
            show(load.rms_torque_nm, "N·m", 1, 2),
            show(load.rms_share_of_stall, "%", 100, 0),
            show(load.after_10_min_c, "°C", 1, 0),
            "no limit" if load.lasts_s is None else show(load.lasts_s, "min", 1 / 60, 1),
            show(load.duty, "%", 100, 0),
            style="" if load.ok else "bold red",
        )
    note = (
        "torque by inverse dynamics of the plans as they would be sent, balance feedback not included; a servo that "
        "has less than the peak gives what it has, and its joint falls behind by the lag; 10 min, lasts, duty: heat if "
        "the motion is repeated, by the servo catalogue's thermal constants"
    )
    return Group(*parts, Text(), drawn, Text(note, style="dim"))


def _verdict(check: TorqueCheck) -> str:
    where = f"{check.robot}, {check.source}, {check.duration_s:.1f} s"
    where += "" if check.supply_v is None else f" at {check.supply_v:g} V"
    allowed = show(check.lag_allowed_rad, "°", math.degrees(1), 1)
    if check.refused:
        return f"{where}: {', '.join(map(repr, check.refused))} was refused, and so not checked"
    if not check.ok:
        joints = "one joint" if len(check.failed) == 1 else f"{len(check.failed)} joints"
        return f"{where}: {joints} of {len(check.joints)} cannot follow (a lag of {allowed} is allowed)"
    worst = check.joints[check.worst]
    if worst.worst is None:
        return f"{where}: every torque is within its servo's envelope, {check.worst} uses {100 * worst.peak_load:.0f} %"
    return (
        f"{where}: every joint follows; {check.worst} is outside its envelope for {worst.over_s:.2f} s and lags by "
        f"{_lag(worst)} at most ({allowed} is allowed)"
    )


def _failure(check: TorqueCheck, joint: JointTorque) -> str:
    """When, for how long and by how much a joint is past its servo."""
    reasons = []
    if joint.lag_rad > check.lag_allowed_rad and joint.worst is not None:
        worst = joint.worst
        reasons.append(
            f"needs {worst.peak_torque_nm:.2f} N·m of {worst.limit_nm:.2f}, {worst.peak_load:.2f} times its envelope, "
            f"at {worst.from_s:.2f} s for {1e3 * worst.for_s:.0f} ms and lags by {_lag(joint)}; outside "
            f"{joint.stretches} {'time' if joint.stretches == 1 else 'times'}, {joint.over_s:.2f} s in all"
        )
    if joint.lasts_s is not None and joint.lasts_s < max(HEAT_S, check.duration_s):
        reasons.append(
            f"{joint.rms_torque_nm:.2f} N·m RMS heats it to its limit in {joint.lasts_s / 60:.1f} min; "
            f"it may do this for {100 * joint.duty:.0f} % of the time"
        )
    return "; ".join(reasons)


def _lag(joint: JointTorque) -> str:
    return show(joint.lag_rad, "°", math.degrees(1), 1)
