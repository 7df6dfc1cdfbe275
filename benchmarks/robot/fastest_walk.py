"""How fast does the robot walk straight ahead, behind a human that is a little faster, and what does that cost it?

The live model's human walks ahead at more than the robot's fastest, and the robot follows in lockstep, nominal and
perturbed. Of each run the steady part is measured on the simulated robot's true motion: the way of its centre of mass
along the heading that it began with, how late the knees are, how far loaded feet slip, the knees' torque, and whether
feet in the air touch the floor. Another run walks for minutes, for the servos' temperature. The constraint that binds
is what the swing of this walk asks most of, by the table that bounds the robot's steps (`retarget/swing.py`). The
limits are those of OP3, whichever robot walks; a figure that is not known does not meet its limit.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from statistics import median
from typing import Annotated, Any

import numpy as np
import typer
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table

from benchmarks.robot.model_run import follow, sampler_of
from benchmarks.robot.simulation import HEAVY_KG
from benchmarks.shared.cells import cell, share
from benchmarks.shared.options import BundleOption, CsvOption, JobsOption
from benchmarks.shared.outcome import Outcome, Verdict, write_csv
from benchmarks.shared.processes import in_order
from flexmotion.configs.robot import Robot, load_robot
from flexmotion.configs.stream import load_stream
from flexmotion.retarget.legs import CHAIN
from flexmotion.retarget.retargeter import Retargeter
from flexmotion.retarget.swing_effort import SwingEffort
from flexmotion.retarget.whole_body import WholeBody
from flexmotion.spatial.gravity import GRAVITY
from flexmotion.streamer.control.estimator import yaw_of
from flexmotion.streamer.control.run_trace import RunTrace
from flexmotion.streamer.motion.intents import Velocity
from flexmotion.streamer.motion.model_source import ModelSource
from flexmotion.streamer.motion.script import Item
from flexmotion.streamer.report.metrics import foot_slip

Float = NDArray[np.float64]

FASTER = 1.25
"""Speed of the human over the fastest walk of the robot, in the scale of the robot's legs."""
BEGUN_S = 3.0
"""The walk is steady from then on [s]."""
MIDDLE = 0.25, 0.75
"""Part of a swing in which a foot must not touch the floor."""
TOUCHES_N = 0.5
"""Ground force of a foot that touches [N]."""
WALKS, LATE_DEG, SLIPS_MM_S, KNEE = 0.20, 6.0, 5.0, 0.30
"""Limits of OP3: speed [m/s], knees late (p95) [degrees], slip [mm/s], torque of a knee over its stall torque (RMS)."""
MEASURED = "speed", "late_deg", "slip_mm_s", "knee", "touched"
"""Figures of `Row` of the steady part."""
OF_WHAT = "torque", "voltage", "speed"
"""What a swing asks of a servo, in the order of `SwingEffort.asked`."""


@dataclass(frozen=True)
class Task:
    """One run: robot by name or folder, speed of the human [m/s]."""

    robot: str
    speed: float
    seed: int
    perturbed: bool
    seconds: float


@dataclass(frozen=True)
class Row:
    """One run; figures of its steady part, None where the robot fell or they are not known.

    Attributes:
        speed: of the robot along the heading that it began with [m/s].
        late_deg: distance of the knees from their reference, 95th percentile [degrees].
        slip_mm_s: mean speed of loaded feet [mm/s].
        knee: RMS torque of the more heavily loaded knee over its stall torque.
        touched: share of the swings in whose middle the foot touched the floor.
        warmest: highest temperature of a servo's windings in the rows that are kept [°C]; None: not known.
        violations: goals outside the envelope.
    """

    seed: int
    perturbed: bool
    upright: bool
    speed: float | None
    late_deg: float | None
    slip_mm_s: float | None
    knee: float | None
    touched: float | None
    warmest: float | None
    violations: int


def run(task: Task, bundle: Path | None) -> Row:
    """One run."""
    robot = load_robot(task.robot)
    walk = Velocity(task.speed, 0.0, 0.0)
    source = ModelSource(sampler_of(bundle), [Item(0.0, walk)], "fastest walk", task.seed, task.seconds)
    found = follow(robot, source, task.perturbed, task.seed, HEAVY_KG)
    record, report = found.record, found.report
    upright = not report.motion.fell
    figures = steady(record, robot) if upright else dict[str, float | None].fromkeys(MEASURED)
    return Row(
        task.seed,
        task.perturbed,
        upright,
        **figures,
        warmest=warmest(record.temperature),
        violations=report.limits.violations_sent,
    )


def warmest(temperature: Float) -> float | None:
    """The highest temperature of any row and joint, (T, n) [°C]; NaN: not read. None: none was read."""
    read = temperature[np.isfinite(temperature)]
    return float(read.max()) if len(read) else None


def steady(record: RunTrace, robot: Robot) -> dict[str, float | None]:
    """The figures of `Row` that belong to the steady part of a run; None: not known."""
    knees = [int(leg.indices[CHAIN.index("knee")]) for leg in WholeBody(robot).legs]
    source_s = record.source_s
    rows = np.isfinite(source_s) & (source_s >= BEGUN_S)
    ticks = np.flatnonzero(rows)
    if len(ticks) < 2:
        return dict.fromkeys(MEASURED)
    first, last = int(ticks[0]), int(ticks[-1])
    yaw = yaw_of(record.true_base[0, 3:])
    ahead = float((record.true_com[last] - record.true_com[first])[:2] @ [np.cos(yaw), np.sin(yaw)])
    late = np.abs(record.q_ref - record.true_q)[rows][:, knees]
    torque = np.sqrt(np.mean(record.true_torque[rows][:, knees] ** 2, axis=0)) / robot.stall_torque[knees]
    slip = foot_slip(record.true_foot_velocity[rows], record.true_foot_force[rows], robot.mass * GRAVITY)
    found = {
        "speed": ahead * record.rate_hz / (last - first),
        "late_deg": float(np.degrees(np.percentile(late, 95))),
        "slip_mm_s": None if slip is None else 1e3 * slip,
        "knee": float(torque.max()),
        "touched": touched(record.contact_ref[rows], record.true_foot_force[rows, :, 2]),
    }
    return {name: None if value is None or np.isnan(value) else value for name, value in found.items()}


def touched(planned: NDArray[np.bool_], force: Float) -> float | None:
    """Share of the swings in whose middle a foot bears something; planned contact and ground force, (T, 2) [N].

    Swings that begin before the first row or end after the last do not count. None: there are no others, or a force in
    the middle of one is not known.
    """
    found = []
    for foot in (0, 1):
        edges = np.flatnonzero(np.diff(planned[:, foot].astype(int)))
        for begin, end in zip(edges[:-1], edges[1:], strict=True):
            if not planned[begin + 1, foot]:
                low, high = (int(begin + part * (end - begin)) for part in MIDDLE)
                found.append(float(force[low : high + 1, foot].max()))
    return share([most > TOUCHES_N for most in found]) if found and np.isfinite(found).all() else None


def binding(robot: Robot) -> dict[str, Any]:
    """The swing of the robot's fastest walk with room for disturbances, and what it asks most of."""
    retargeter = Retargeter(robot, load_stream())
    swings, effort = retargeter.swings, SwingEffort(robot, retargeter.body.legs, retargeter.omega)
    seconds = swings.brisk_s[1]
    travel = 2.0 * swings.stride(seconds)
    path = swings.path(effort.phase, 0, np.zeros(4), np.array([travel, 0.0, 0.0, 0.0]))
    progress, way = path[None, :, 0] / travel, np.array([[travel, 0.0, 0.0]])
    most = np.abs(effort.asked(progress, path[None, :, 2], way, np.array([seconds]))[0]).max(axis=0)
    parts = np.ndindex(most.shape)
    shares = {f"{OF_WHAT[part]} of {CHAIN[joint]}": float(most[part, joint]) for part, joint in parts}
    hardest = sorted(shares, key=shares.__getitem__, reverse=True)[:3]
    return {
        "stride_m": 0.5 * travel,
        "swing_s": seconds,
        "clearance_m": swings.clearance,
        "double_support_s": swings.pause_s,
        "speed_by_table": 0.5 * travel / (seconds + swings.pause_s),
        "hardest": {name: shares[name] for name in hardest},
    }


def human_speed(robot: str, bundle: Path | None) -> float:
    """Speed of a human that is `FASTER` than the robot's fastest walk [m/s]."""
    retargeter = Retargeter(load_robot(robot), load_stream())
    return FASTER * retargeter.swings.speed * sampler_of(bundle).body.leg / retargeter.body.leg_length


def table(rows: Sequence[Row]) -> Table:
    """One row a run."""
    out = Table(title="The steady part of each run")
    for name in ("seed", "", "upright", "m/s", "knees late °", "slip mm/s", "knee / stall", "swings that touch", "°C"):
        out.add_column(name, justify="right")
    for row in rows:
        figures = (
            (row.speed, ".3f"),
            (row.late_deg, ".1f"),
            (row.slip_mm_s, ".1f"),
            (row.knee, ".2f"),
            (row.touched, ".0%"),
            (row.warmest, ".0f"),
        )
        cells = [cell(value, form) for value, form in figures]
        out.add_row(str(row.seed), "perturbed" if row.perturbed else "", "yes" if row.upright else "fell", *cells)
    return out


def group_of(rows: Sequence[Row]) -> dict[str, Any]:
    """Figures of runs: medians over those upright; None where there is none, or one of them is not known."""
    up = [row for row in rows if row.upright]
    columns = {name: [getattr(row, name) for row in up] for name in MEASURED}
    medians = {name: median(column) if column and None not in column else None for name, column in columns.items()}
    outside = sum(row.violations for row in rows)
    return medians | {"upright": share([row.upright for row in rows]), "runs": len(rows), "outside": outside}


def verdicts(name: str, group: dict[str, Any]) -> list[Verdict]:
    """What the runs of a group must keep; `group`: of `group_of`."""
    speed, late, slip, knee = (group[key] for key in MEASURED[:4])
    up, runs = round(group["upright"] * group["runs"]), group["runs"]
    return [
        Verdict(f"{name}: upright {up} of {runs} (all)", up == runs),
        Verdict(f"{name}: {cell(speed, '.3f')} m/s (>= {WALKS:.2f})", speed is not None and speed >= WALKS),
        Verdict(f"{name}: knees late, p95: {cell(late, '.1f')}° (<= {LATE_DEG:g})", _within(late, LATE_DEG)),
        Verdict(f"{name}: slip {cell(slip, '.1f')} mm/s (<= {SLIPS_MM_S:g})", _within(slip, SLIPS_MM_S)),
        Verdict(f"{name}: knee RMS over stall {cell(knee)} (<= {KNEE:.2f})", _within(knee, KNEE)),
        Verdict(f"{name}: goals outside the envelope: {group['outside']} (0)", group["outside"] == 0),
    ]


def _within(value: float | None, limit: float) -> bool:
    return value is not None and value <= limit


def main(
    robot: Annotated[str, typer.Option(help="Name or folder.")] = "op3",
    bundle: BundleOption = None,
    seeds: Annotated[int, typer.Option(min=1, help="Runs, nominal and perturbed each.")] = 5,
    first: Annotated[int, typer.Option(min=0, help="First seed.")] = 100,
    seconds: Annotated[float, typer.Option(min=6.0, help="Length of a run [s].")] = 15.0,
    minutes: Annotated[float, typer.Option(min=0.0, help="Length of the walk for the temperature.")] = 10.0,
    jobs: JobsOption = 1,
    csv_out: CsvOption = None,
) -> Outcome:
    """Walk as fast as the robot can."""
    speed = human_speed(robot, bundle)
    tasks = [
        Task(robot, speed, seed, perturbed, seconds)
        for seed in range(first, first + seeds)
        for perturbed in (False, True)
    ]
    rows = in_order(partial(run, bundle=bundle), tasks, jobs)
    console = Console(width=120)
    console.print(table(rows))
    bound = binding(load_robot(robot))
    console.print({"human m/s": round(speed, 3)} | bound)
    if csv_out is not None:
        write_csv(csv_out, [asdict(row) for row in rows])
    figures: dict[str, Any] = {"human": speed, "binding": bound}
    found = list[Verdict]()
    for name in ("nominal", "perturbed"):
        figures[name] = group_of([row for row in rows if row.perturbed == (name == "perturbed")])
        found += verdicts(name, figures[name])
    if minutes:
        model = load_robot(robot)
        long = run(Task(robot, speed, first, False, 60.0 * minutes), bundle)
        limit = min(servo.temperature_limit for servo in model.servos)
        figures["long"] = asdict(long) | {"minutes": minutes}
        cool = long.upright and long.warmest is not None and long.warmest < limit
        sentence = f"warmest servo after {minutes:g} min: {cell(long.warmest, '.0f')} °C (< {limit:g})"
        found.append(Verdict(sentence, cool))
    hardest, most = next(iter(bound["hardest"].items()))
    figures["hardest"] = f"{hardest}: {most:.2f}"
    return Outcome(found, figures)
