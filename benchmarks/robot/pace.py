"""How fast may the human go so that the robot keeps up, in each direction?

The model's human moves at each velocity of `SPEEDS`, not slowed, and the robot follows, nominal and perturbed. The
faster the human, the smaller the share of its way that the robot covers: `gait.pace` of a robot file is how fast a
human may go, in the scale of the robot's legs. Printed are medians over the runs that stay upright, in that scale. At
the pace of the robot file the robot must cover `KEEPS_UP` of the way, at `NO_SLOWER` of its own best speed (a human who
hardly moves is easily followed), and stay upright in `STAYS_UP` of the runs.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from functools import partial
from math import isclose
from pathlib import Path
from statistics import median
from typing import Annotated, Any

import typer
from rich.console import Console
from rich.table import Table

from benchmarks.robot.model_run import follow, sampler_of
from benchmarks.shared.cells import cell, middle, share
from benchmarks.shared.options import BundleOption, CsvOption, JobsOption
from benchmarks.shared.outcome import Outcome, Verdict, write_csv
from benchmarks.shared.processes import in_order
from flexmotion.configs.robot import load_robot
from flexmotion.streamer.motion.intents import Velocity
from flexmotion.streamer.motion.model_source import ModelSource
from flexmotion.streamer.motion.robot_pace import human_pace
from flexmotion.streamer.motion.script import Item
from flexmotion.streamer.report.report import DisplacementSection

SPEEDS: dict[str, tuple[float, ...]] = {
    "ahead": (0.4, 0.6, 0.8, 1.0, 1.2),
    "back": (0.3, 0.45, 0.6, 0.8, 1.0),
    "aside": (0.15, 0.2, 0.25, 0.3),
    "turning": (0.3, 0.5, 0.7, 0.85, 1.0),
}
"""Of the human [m/s, rad/s]."""
KEEPS_UP, NO_SLOWER, STAYS_UP = 0.4, 0.7, 0.9
HEAVIER = 1.11
"""Mass of the perturbed robot over its own; 3.5 kg of an OP3."""


@dataclass(frozen=True)
class Task:
    """One run; motion aside and turning are to the left with even seeds, to the right with odd ones."""

    robot: str
    direction: str
    speed: float
    seed: int
    perturbed: bool
    seconds: float

    @property
    def velocity(self) -> Velocity:
        """The human's commanded velocity."""
        side = self.speed if self.seed % 2 == 0 else -self.speed
        return {
            "ahead": Velocity(self.speed, 0.0, 0.0),
            "back": Velocity(-self.speed, 0.0, 0.0),
            "aside": Velocity(0.0, side, 0.0),
            "turning": Velocity(0.0, 0.0, side),
        }[self.direction]


@dataclass(frozen=True)
class Row:
    """One run; speeds of human and robot along the direction, in the robot's scale [m/s, rad/s]."""

    direction: str
    speed: float
    seed: int
    perturbed: bool
    upright: bool
    human: float
    robot: float
    violations: int

    @property
    def share(self) -> float:
        """Share of the human's way that the robot covered."""
        return self.robot / self.human if self.human > 0 else 0.0


def run(task: Task, bundle: Path | None) -> Row:
    """One run."""
    robot = load_robot(task.robot)
    source = ModelSource(sampler_of(bundle), [Item(0.0, task.velocity)], "pace", task.seed, task.seconds)
    report = follow(robot, source, task.perturbed, task.seed, HEAVIER * robot.mass).report
    went = (report.motion.human_went, report.motion.robot_went)
    human_speed, robot_speed = (0.0 if one is None else _along(one, task) / task.seconds for one in went)
    return Row(
        task.direction,
        task.speed,
        task.seed,
        task.perturbed,
        not report.motion.fell,
        human_speed,
        robot_speed,
        report.limits.violations_sent,
    )


def _along(went: DisplacementSection, task: Task) -> float:
    """Displacement in the commanded direction [m, rad]."""
    velocity = task.velocity
    along: float = went.ahead_m * velocity.forward + went.left_m * velocity.left + went.turned_rad * velocity.turning
    return along / task.speed


def speeds_of(robot: str, bundle: Path | None) -> dict[str, tuple[float, ...]]:
    """Velocities of the human in each direction; the pace of the robot file is one of them."""
    pace = human_pace(load_robot(robot), sampler_of(bundle).body)
    if pace is None:
        return SPEEDS
    found = {}
    for direction, speeds in SPEEDS.items():
        limit = getattr(pace, direction)
        others = (speed for speed in speeds if not isclose(speed, limit, rel_tol=0.02))
        found[direction] = tuple(sorted([limit, *others]))
    return found


def groups_of(rows: Sequence[Row]) -> dict[str, dict[str, Any]]:
    """Figures of each velocity; medians over the runs that stayed upright."""
    found = {}
    for direction, speed in dict.fromkeys((row.direction, row.speed) for row in rows):
        own = [row for row in rows if (row.direction, row.speed) == (direction, speed)]
        up = [row for row in own if row.upright]
        medians = {name: middle([getattr(row, name) for row in up]) for name in ("human", "robot", "share")}
        found[f"{direction} {speed:.3g}"] = {"runs": len(own), "upright": len(up)} | medians
    return found


def table(groups: dict[str, dict[str, Any]]) -> Table:
    """One row a velocity."""
    out = Table(title="A robot behind a human (medians of those upright, in the robot's scale)")
    for column in ("commanded", "runs", "upright", "human", "robot", "share"):
        out.add_column(column, justify="right")
    for name, own in groups.items():
        cells = [cell(own[column], ".3f") for column in ("human", "robot", "share")]
        out.add_row(name, str(own["runs"]), str(own["upright"]), *cells)
    return out


def verdicts(rows: Sequence[Row], robot_name: str, bundle: Path | None) -> list[Verdict]:
    """At the pace of the robot file."""
    pace = human_pace(load_robot(robot_name), sampler_of(bundle).body)
    found = []
    for direction in SPEEDS if pace is not None else ():
        limit = getattr(pace, direction)
        own = [row for row in rows if (row.direction, row.speed) == (direction, limit)]
        up = [row for row in own if row.upright]
        covered, stays = middle([row.share for row in up]) or 0.0, share([row.upright for row in own])
        ways = [row for row in rows if row.direction == direction and row.upright]
        speeds = [median(r.robot for r in ways if r.speed == speed) for speed in {row.speed for row in ways}]
        best = max(speeds, default=0.0)
        speed = median(row.robot for row in up) / best if up and best > 0 else 0.0
        at = f"{direction}, the human at {limit:.2f}"
        found.append(Verdict(f"{at}: covers {covered:.2f} of the way (>= {KEEPS_UP})", covered >= KEEPS_UP))
        found.append(Verdict(f"{at}: {speed:.2f} of its own best speed (>= {NO_SLOWER})", speed >= NO_SLOWER))
        found.append(Verdict(f"{at}: upright {100 * stays:.0f} % (>= {100 * STAYS_UP:.0f})", stays >= STAYS_UP))
    sent = sum(row.violations for row in rows)
    return [*found, Verdict(f"goals outside the envelope: {sent} (0)", sent == 0)]


def main(
    robot: Annotated[str, typer.Option(help="Name or folder.")] = "op3",
    bundle: BundleOption = None,
    seeds: Annotated[int, typer.Option(min=1, help="Runs of each velocity, nominal and perturbed each.")] = 3,
    seconds: Annotated[float, typer.Option(min=4.0, help="Length of a run [s].")] = 8.0,
    jobs: JobsOption = 1,
    csv_out: CsvOption = None,
) -> Outcome:
    """Run all velocities."""
    tasks = [
        Task(robot, direction, speed, seed, perturbed, seconds)
        for seed in range(seeds)
        for direction, speeds in speeds_of(robot, bundle).items()
        for speed in speeds
        for perturbed in (False, True)
    ]
    rows = in_order(partial(run, bundle=bundle), tasks, jobs)
    rows.sort(key=lambda row: (row.direction, row.speed, row.seed, row.perturbed))
    groups = groups_of(rows)
    Console(width=120).print(table(groups))
    if csv_out is not None:
        write_csv(csv_out, [asdict(row) for row in rows])
    return Outcome(verdicts(rows, robot, bundle), groups)
