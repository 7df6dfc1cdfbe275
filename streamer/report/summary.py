"""The report for a terminal: the verdict first, then short tables."""

from __future__ import annotations

import math
from collections import Counter

from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from flexmotion.streamer.motion.heard import not_done
from flexmotion.streamer.report.report import DisplacementSection, Latency, Report

WORST_JOINTS = 5
"""Joints shown in the terminal; the others are in `report.json`."""
ASKED_SHOWN = 12
"""Answers shown in the terminal; all are in `report.json` and the JSON output."""
_CUT_SHORT = ("READY", "STREAMING", "PARK")
"""Final states of a run that was ended at once: torque was cut where the robot was."""


def failures(report: Report) -> list[str]:
    """Every reason why the run failed, in words, what concerns safety first; empty if it is ok."""
    reasons = []
    motion, loop = report.motion, report.loop
    if motion.fell:
        reasons.append("fell" if motion.time_to_fall_s is None else f"fell after {motion.time_to_fall_s:.2f} s")
    reasons += [
        f"fault: {fault}" + (f" ({times} times)" if times > 1 else "")
        for fault, times in Counter(report.safety.faults).items()
    ]
    if report.limits.violations_sent:
        reasons.append(f"{report.limits.violations_sent} goals outside a servo's envelope left the loop")
    if report.cut_by == "interrupt":
        reasons.append("interrupted")
    if report.safety.final_state in _CUT_SHORT:
        reasons.append(f"cut short in {report.safety.final_state}, torque off")
    if report.planner.plans == 0:
        reasons.append("no plan was ever played")
    if report.planner.underruns and not report.ok:
        reasons.append(f"{report.planner.underruns} plans came too late")
    if loop.missed_deadlines > loop.missed_allowed:
        reasons.append(f"{loop.missed_deadlines} of {loop.cycles} deadlines missed, {loop.missed_allowed} allowed")
    if not report.ok and not report.options.get("allow_refused"):
        reasons += _not_done(report)
    wanted = report.options.get("min_likeness")
    if wanted is not None and (report.likeness is None or report.likeness.score < wanted):
        reasons.append(f"{likeness_words(report)}, at least {wanted:g} was asked for")
    if not (report.ok or reasons):
        reasons.append(f"ended in {report.safety.final_state}")
    return reasons


def _not_done(report: Report) -> list[str]:
    """What was asked and not done, and plans that were refused: one thing in words, several by number."""
    found = not_done(report.targets)
    plans = report.planner.refusals
    reasons = list(plans) if len(plans) < 2 else [f"{len(plans)} plans refused: {plans[0]}"]
    if any(heard.failure is None for heard, _ in found) and report.cut_by == "seconds":
        reasons.append("--seconds ended the run first")
    if len(found) == 1:
        return [short(found[0][1]), *reasons]
    refused = sum(heard.state == "refused" for heard, _ in found)
    counts = [(refused, "refused"), (len(found) - refused, "not done whole")]
    told = " and ".join(f"{count} {what}" for count, what in counts if count)
    return [f"of {len(report.targets)} requests {told}, listed below"] * bool(found) + reasons


def short(reason: str) -> str:
    """A reason without what the model can do; what to try instead comes before that."""
    return reason.partition("; it can: ")[0]


def verdict(report: Report) -> str:
    """One sentence: what was run, whether it is ok, and how much of the human's motion the robot did."""
    what = f"{report.robot} on {report.driver}, {report.source}, {report.duration_s:.1f} s"
    if not report.ok:
        told = failures(report)
        known = report.likeness is not None and not any(reason.startswith("likeness") for reason in told)
        return f"{what}: {'; '.join([*told, *([likeness_words(report)] if known else [])])}"
    like = "" if report.likeness is None else f"; {likeness_words(report)}"
    return f"{what}: upright, no fault, no limit passed{like}"


def likeness_words(report: Report) -> str:
    """The likeness and what was left out, each with its share, in words; what was never reached is left out too."""
    found = report.likeness
    if found is None:
        return "likeness unknown"
    missing = [f"{name} ({100 * found.parts[name]:.0f} %)" for name in found.left_out]
    items = [heard.reached for heard in report.targets if heard.item is not None]
    missing += [f"{items.count(False)} of {len(items)} items (not reached)"] * (False in items)
    until = " until the fall" if report.motion.fell else ""
    what = f"left out: {', '.join(missing)}" if missing else f"nothing left out{until}"
    return f"likeness {100 * found.score:.0f} %{until}, {what}"


def likeness_rows(report: Report) -> list[tuple[str, str, str]]:
    """Name, value with unit, and meaning of the likeness, of each part that the human does, and of the directions."""
    found = report.likeness
    if found is None:
        return []
    meaning = {
        "path": "of the human's way, scaled by leg length: furthest from the start, while the human moves",
        "turn": f"of the human's turn of {abs(found.human_turned_deg):.0f}°",
        "bend": f"of the human's bend, {found.human_bend_deg:.0f}°",
        "flight": f"of the {found.human_flight_s:.2f} s in which no foot of the human is on the ground",
        "hands": "of what the human's arms do, by the directions of their segments",
    }
    parts = [
        (name, show(share, "%", 100, 0), meaning[name] + (", left out" if name in found.left_out else ""))
        for name, share in found.parts.items()
    ]
    out = show(found.unreachable_share, "%", 100, 0)
    rows = [
        ("likeness", show(found.score, "%", 100, 0), "mean of the parts below" if parts else "the human only stands"),
        *parts,
        ("upper arms", show(found.upper_arm_deg, "°", 1, 1), "off the human's direction, mean of all samples"),
        ("forearms", show(found.forearm_deg, "°", 1, 1), f"the same; a hand out of reach in {out} of the samples"),
        ("trunk", show(found.trunk_deg, "°", 1, 1), "off the human's lean, mean of all samples"),
    ]
    return [row for row in rows if row[1] != "-"]


def render(report: Report) -> RenderableType:
    """The report for a `rich` console."""
    mark = Text("PASS ", style="bold green") if report.ok else Text("FAIL ", style="bold red")
    parts: list[RenderableType] = [mark + Text(verdict(report), style="bold"), Text()]
    if report.planner.plans == 0:
        return parts[0]  # without a plan there are no figures
    for section in (_asked(report), _likeness(report), _motion(report), _joints(report), _timing(report)):
        parts += [*section, Text()] if section else []
    return Group(*parts[:-1])


def motion_rows(report: Report) -> list[tuple[str, str, str]]:
    """Name, value with unit, and meaning of every known motion figure."""
    m = report.motion
    collisions = "-" if m.self_collisions is None else str(m.self_collisions)
    steps = steps_words(m.steps_planned, m.steps_inserted, m.human_steps, m.steps_dropped or 0)
    steps = f"of the whole run, {steps}" if m.period_begin_s > 0.0 else steps
    rows = [
        ("leg tracking error", show(m.joint_rmse_rad, "°", math.degrees(1)), "RMS, measured against reference"),
        ("lag", show(m.lag_s, "ms", 1e3, 0), "measured behind reference, removed from the error"),
        ("foot slip", show(m.foot_slip_mm_s, "mm/s"), "mean speed of feet that carry load"),
        (
            "net path",
            show(m.net_path_ratio, "", 1.0, 2),
            "robot over human, scaled by leg length: from start to end, once the robot stands again",
        ),
        ("went", _went(m.robot_went), f"when it stands again; the human, scaled: {_went(m.human_went)}"),
        ("behind", show(m.behind_m, "m", 1.0, 2), "the human's place, scaled, with the source's last frame"),
        ("heading error", show(m.heading_rms_rad, "°", math.degrees(1), 1), "RMS, robot against human"),
        ("hand error", show(m.hand_error_share, "%", 100, 1), "median, of arm length, where within reach"),
        ("arm stiffness", show(m.limb_stiffness, "%", 100, 0), "mean, of arms and head; less where the human is slack"),
        ("steps", f"{m.steps_planned}", steps),
        ("effort", _effort(report), "correlation of the human's torques with the robot's, all joints"),
        ("self-collisions", collisions, "separate touches of two links"),
    ]
    return [row for row in rows if row[1] != "-"]


def steps_words(planned: int, inserted: int, human: int | None, dropped: int) -> str:
    """What the planned footsteps are of, so that the parts give their sum; `human`: None, not known."""
    corrected = f"{inserted} inserted to correct the feet or bring them together"
    if human is None:
        return f"planned, {corrected}" if inserted else "planned"
    followed = planned - inserted
    dropped = max(dropped, human - followed)
    added = followed - human + dropped
    parts = [
        f"the human made {human}",
        *([f"{dropped} dropped"] if dropped else []),
        *([f"{added} added in the robot's own cadence"] if added else []),
        *([corrected] if inserted else []),
    ]
    return f"planned: {', '.join(parts)}"


def motion_title(report: Report) -> str:
    """Title of the motion figures, with the part of the run that they are of where it is not all of it."""
    begin, end = report.motion.period_begin_s, report.motion.period_end_s
    return f"Motion from {begin:.0f} to {end:.0f} s" if begin > 0.0 else "Motion"


def joint_rows(report: Report) -> list[tuple[str, ...]]:
    """Name, RMS torque, its share of stall, peak, limit, peak speed, time at the limit; highest load first."""
    hardest = sorted(report.limits.joints.items(), key=lambda item: -(item[1].rms_share_of_stall or 0.0))
    return [
        (
            name,
            show(joint.rms_torque_nm, "N·m", 1, 2),
            show(joint.rms_share_of_stall, "%", 100, 0),
            show(joint.peak_torque_nm, "N·m", 1, 2),
            show(joint.torque_limit_nm, "N·m", 1, 2),
            show(joint.peak_speed_rad_s, "rad/s", 1, 1),
            show(joint.saturated_share, "%", 100, 1),
        )
        for name, joint in hardest
    ]


def torque_note(report: Report) -> str:
    """Note on the source of the joints' torques, unless it is the simulation, and on peaks beyond the usable torque."""
    sources = {"simulation": "", "servos": "torque as the servos measure it, by their current", None: "torque unknown"}
    beyond = any((one.peak_torque_nm or 0.0) > one.torque_limit_nm for one in report.limits.joints.values())
    braking = "peak above usable: braking, where a servo may give up to its stall torque" if beyond else ""
    return "; ".join(filter(None, (sources[report.limits.torque_source], braking)))


def timing_rows(report: Report) -> list[tuple[str, ...]]:
    """Name, median, 99th percentile and maximum of every time that was measured."""
    loop, planner = report.loop, report.planner
    latencies: list[tuple[str, Latency | None, str]] = [
        ("loop work", loop.work_us, "µs"),
        ("wake lateness", loop.wake_lateness_us, "µs"),
        ("robot lateness", loop.robot_lateness_us, "µs"),
        ("sample", planner.sample_ms, "ms"),
        ("retarget", planner.retarget_ms, "ms"),
        ("target to command", planner.target_to_command_ms, "ms"),
        ("target to effect", planner.target_to_effect_ms, "ms"),
    ]
    return [
        (name, *(show(value, unit) for value in (latency.p50, latency.p99, latency.max)))
        for name, latency, unit in latencies
        if latency is not None
    ]


def asked_rows(report: Report) -> list[tuple[str, str, str, str]]:
    """What was asked, its state, what it was heard as with the listener's share, and what the robot did of it."""
    rows: list[tuple[str, str, str, str]] = []
    for heard in report.targets:
        share = "" if heard.certainty is None or heard.heard_as is None else f" ({100 * heard.certainty:.0f} %)"
        done = [
            f"{step.motion}: {step.done}{'' if step.end in (None, 'done') else f', {step.end}'}"
            for step in heard.steps
            if step.end is not None
        ]
        notes = [
            heard.reason and short(heard.reason),
            heard.slowed and f"slowed to {heard.slowed}",
            heard.manner and f"manner: {heard.manner}",
            *heard.notes,
            *done,
        ]
        notes += [f"not done: {', '.join(heard.dropped)}"] if heard.dropped else []
        state = heard.state if heard.reached else "not reached"
        rows.append((heard.asked, state, f"{heard.heard_as or '-'}{share}", "; ".join(filter(None, notes))))
    return rows


def _asked(report: Report) -> list[RenderableType]:
    if not report.targets:
        return []
    drawn = table("Asked", "", "", "", "")
    rows = asked_rows(report)
    # What was not done is shown first of all, in the order in which it was asked.
    missed = [heard for heard, _ in not_done(report.targets)]
    failed = [place for place, heard in enumerate(report.targets) if heard in missed]
    others = [place for place in range(len(rows)) if place not in failed]
    for asked, state, heard, notes in (rows[place] for place in sorted([*failed, *others][:ASKED_SHOWN])):
        drawn.add_row(*(Text(part) for part in (asked, state, heard)), Text(notes, style="dim"))
    more = len(report.targets) - ASKED_SHOWN
    return [
        drawn,
        *([Text(f"and {more} more: all of them with --report FOLDER or --json", style="dim")] if more > 0 else []),
    ]


def _motion(report: Report) -> list[RenderableType]:
    drawn = table(motion_title(report), "", "", "")
    for name, value, meaning in motion_rows(report):
        drawn.add_row(name, value, Text(meaning, style="dim"))
    return [drawn]


def _likeness(report: Report) -> list[RenderableType]:
    rows = likeness_rows(report)
    if not rows:
        return []
    drawn = table("Likeness", "", "", "")
    for name, value, meaning in rows:
        drawn.add_row(name, value, Text(meaning, style="dim"))
    return [drawn]


def _effort(report: Report) -> str:
    return "-" if report.torque_profile is None else show(report.torque_profile.correlation, "", 1, 2)


def _went(way: DisplacementSection | None) -> str:
    """A displacement with its directions in words."""
    if way is None:
        return "-"
    # Rounded first: a value that rounds to zero has no direction.
    ahead, left, turned = round(way.ahead_m, 2), round(way.left_m, 2), round(math.degrees(way.turned_rad))
    return (
        f"{abs(ahead):.2f} m {'back' if ahead < 0 else 'ahead'}, "
        f"{abs(left):.2f} m {'right' if left < 0 else 'left' if left else 'aside'}, "
        f"turned {abs(turned)}°{' right' if turned < 0 else ' left' if turned else ''}"
    )


def _joints(report: Report) -> list[RenderableType]:
    limits = report.limits
    columns = ("joint", "rms", "of stall", "peak", "usable", "speed", "at limit")
    drawn = table(f"Hardest worked of {len(limits.joints)} joints", *columns)
    for row in joint_rows(report)[:WORST_JOINTS]:
        drawn.add_row(*row)
    repairs = ", ".join(f"{count} {kind}" for kind, count in limits.repairs.items() if count) or "none"
    note = f"goals outside the envelope that left the loop: {limits.violations_sent}; repairs: {repairs}"
    return [drawn, Text("; ".join(filter(None, (torque_note(report), note))), style="dim")]


def _timing(report: Report) -> list[RenderableType]:
    loop, planner = report.loop, report.planner
    drawn = table("Time", "", "p50", "p99", "max")
    for row in timing_rows(report):
        drawn.add_row(*row)
    speed = f"{loop.realtime_factor:.1f} times real time; " if loop.realtime_factor else ""
    # In lockstep there are no deadlines.
    missed = f"{loop.missed_deadlines} missed deadlines; " if report.clock == "real" else ""
    note = (
        f"{report.clock} clock, {loop.rate_hz:g} Hz, {loop.cycles} cycles; {speed}{planner.plans} plans, "
        f"{planner.underruns} under-runs; {missed}ended {report.safety.final_state}"
    )
    return [drawn, Text(note, style="dim")]


def table(title: str, *columns: str) -> Table:
    """A table in the style of all reports: first column left, numbers right, no frame; column names may be empty."""
    drawn = Table(title=title or None, title_justify="left", title_style="bold", box=None, pad_edge=False)
    drawn.show_header = any(columns)
    for index, column in enumerate(columns):
        drawn.add_column(column, justify="left" if index == 0 or not any(columns) else "right", header_style="dim")
    return drawn


def show(value: float | None, unit: str, scale: float = 1.0, digits: int | None = None) -> str:
    """A figure times `scale` with its unit; `digits` decimals, by default three significant digits down to 0.001."""
    if value is None:
        return "-"
    scaled = value * scale
    if digits is None:
        digits = 2 - math.floor(math.log10(abs(scaled))) if scaled else 0
    text = f"{scaled:.{min(max(digits, 0), 3)}f}"
    return text + ("" if unit in ("", "°") else " ") + unit
