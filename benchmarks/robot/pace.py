"""How fast is a robot? Velocities in each direction, faster and faster, through the whole live system.

    python benchmarks/robot_pace.py [--robot op3] [--bundle DIR] [--seeds 3] [--seconds 8] [--jobs 2] [--csv FILE]

A model's human goes at each velocity of SPEEDS, unslowed, the robot after it, nominal and perturbed as in
robot_prompts.py. Where the human is faster than the robot can be, it comes less and less of the way: `gait.pace` of a
robot file is how fast a human may go, in the scale of the robot's legs, of whose way it still comes enough. Printed are
medians over the runs that stay up, in that scale. Exits with 1 where at the pace of the robot file it comes less than
KEEPS_UP of the way, goes slower than NO_SLOWER of its own best (a human who hardly moves is easily followed), or stays
up in less than STAYS_UP of the runs.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import asdict, dataclass
from functools import lru_cache
from math import isclose
from multiprocessing import get_context
from pathlib import Path
from statistics import median
from typing import Annotated

import typer
from rich.console import Console
from rich.progress import Progress
from rich.table import Table
from verdicts import Verdict, benchmark, write_csv

from flexmotion.configs.robot import load_robot
from flexmotion.configs.stream import load_stream
from flexmotion.drivers.registry import create
from flexmotion.sampling.sampler import Sampler
from flexmotion.streamer.commands.choice import open_sampler
from flexmotion.streamer.commands.driver_options import simulation_options
from flexmotion.streamer.motion.intents import Velocity
from flexmotion.streamer.motion.model_source import ModelSource
from flexmotion.streamer.motion.robot_pace import human_pace
from flexmotion.streamer.motion.script import Item
from flexmotion.streamer.report.metrics import Displacement, HumanTrack, RobotFigures
from flexmotion.streamer.report.report import RunInfo, build_report
from flexmotion.streamer.run.played_human import human_motion
from flexmotion.streamer.run.session import Session

SPEEDS: dict[str, tuple[float, ...]] = {
    "ahead": (0.4, 0.6, 0.8, 1.0, 1.2),
    "back": (0.3, 0.45, 0.6, 0.8),
    "aside": (0.15, 0.2, 0.25, 0.3),
    "turning": (0.3, 0.5, 0.7, 1.0),
}
"""Of the human [m/s, rad/s]."""
KEEPS_UP, NO_SLOWER, STAYS_UP = 0.4, 0.7, 0.9
"""Shares: of the human's way that who keeps up comes, of its own best speed that way, and of runs that stay up."""
HEAVIER = 1.11
"""Mass of the disturbed robot over its own: OP3's 3.5 kg of robot_prompts.py."""


@dataclass(frozen=True)
class Task:
    """One run; aside and turning are to the left in even seeds."""

    robot: str
    direction: str
    speed: float
    seed: int
    perturbed: bool
    seconds: float

    @property
    def velocity(self) -> Velocity:
        """What the human is asked for."""
        side = self.speed if self.seed % 2 == 0 else -self.speed
        return {
            "ahead": Velocity(self.speed, 0.0, 0.0),
            "back": Velocity(-self.speed, 0.0, 0.0),
            "aside": Velocity(0.0, side, 0.0),
            "turning": Velocity(0.0, 0.0, side),
        }[self.direction]


@dataclass(frozen=True)
class Row:
    """One run as it went; speeds of human and robot along the direction, in the robot's scale [m/s, rad/s]."""

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
        """How much of the human's way the robot came."""
        return self.robot / self.human if self.human > 0 else 0.0


@lru_cache
def _sampler(bundle: Path | None) -> Sampler:
    return open_sampler(bundle, "this benchmark")


def run(task: Task, bundle: Path | None) -> Row:
    """One run."""
    robot = load_robot(task.robot)
    source = ModelSource(_sampler(bundle), [Item(0.0, task.velocity)], "pace", task.seed, task.seconds)
    options = simulation_options(task.perturbed, [f"total_mass={HEAVIER * robot.mass:.3f}"] if task.perturbed else [])
    driver = create("sim", robot, **options, seed=task.seed)
    record = Session(robot, driver, source, load_stream(), source.seconds).run("lockstep")
    human = human_motion(source, record)
    assert human is not None
    figures = RobotFigures.of(robot, human.body.leg)
    info = RunInfo(robot.name, "sim", source.name, task.seed, "lockstep")
    report = build_report(record, info, figures, human=HumanTrack.of(human))
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


def _along(went: Displacement, task: Task) -> float:
    """How far somebody came in the direction that was asked for [m, rad]."""
    velocity = task.velocity
    parts = (went.ahead_m * velocity.forward, went.left_m * velocity.left, went.turned_rad * velocity.turning)
    return sum(parts) / task.speed


def speeds_of(robot: str, bundle: Path | None) -> dict[str, tuple[float, ...]]:
    """What the human is asked for in each direction, the robot file's pace among it."""
    pace = human_pace(load_robot(robot), _sampler(bundle).body)
    if pace is None:
        return SPEEDS
    found = {}
    for direction, speeds in SPEEDS.items():
        limit = getattr(pace, direction)
        others = (speed for speed in speeds if not isclose(speed, limit, rel_tol=0.02))
        found[direction] = tuple(sorted([limit, *others]))
    return found


def table(rows: Sequence[Row]) -> Table:
    """One row a velocity."""
    out = Table(title="A robot behind a human (medians of those upright, in the robot's scale)")
    for column in ("asked of the human", "runs", "upright", "human", "robot", "share"):
        out.add_column(column, justify="right")
    for direction, speed in dict.fromkeys((row.direction, row.speed) for row in rows):
        own = [row for row in rows if (row.direction, row.speed) == (direction, speed)]
        up = [row for row in own if row.upright]
        middle = [f"{median(values):.3f}" for values in zip(*((r.human, r.robot, r.share) for r in up), strict=True)]
        out.add_row(f"{direction} {speed:.3g}", str(len(own)), str(len(up)), *middle)
    return out


def verdicts(rows: Sequence[Row], robot_name: str, bundle: Path | None) -> list[Verdict]:
    """At the pace of the robot file."""
    pace = human_pace(load_robot(robot_name), _sampler(bundle).body)
    found = []
    for direction in SPEEDS if pace is not None else ():
        limit = getattr(pace, direction)
        ways = [row for row in rows if row.direction == direction and row.upright]
        own = [row for row in rows if (row.direction, row.speed) == (direction, limit)]
        up = [row for row in own if row.upright]
        share, stays = median(row.share for row in up) if up else 0.0, len(up) / len(own)
        speeds = [median(r.robot for r in ways if r.speed == speed) for speed in {row.speed for row in ways}]
        best = max(speeds, default=0.0)
        speed = median(row.robot for row in up) / best if up and best > 0 else 0.0
        at = f"{direction}, the human at {limit:.2f}"
        found.append(Verdict(f"{at}: comes {share:.2f} of the way (>= {KEEPS_UP})", share >= KEEPS_UP))
        found.append(Verdict(f"{at}: {speed:.2f} of its own best speed (>= {NO_SLOWER})", speed >= NO_SLOWER))
        found.append(Verdict(f"{at}: upright {100 * stays:.0f} % (>= {100 * STAYS_UP:.0f})", stays >= STAYS_UP))
    sent = sum(row.violations for row in rows)
    return [*found, Verdict(f"goals outside the envelope: {sent} (0)", sent == 0)]


def main(
    robot: Annotated[str, typer.Option(help="Name or folder.")] = "op3",
    bundle: Annotated[Path | None, typer.Option(help="Bundle to sample from; else the shipped one.")] = None,
    seeds: Annotated[int, typer.Option(min=1, help="Runs of each velocity, nominal and perturbed each.")] = 3,
    seconds: Annotated[float, typer.Option(min=4.0, help="Each [s].")] = 8.0,
    jobs: Annotated[int, typer.Option(min=1, help="Runs at a time.")] = 1,
    csv_out: Annotated[Path | None, typer.Option("--csv", help="Write one row a run here.")] = None,
) -> list[Verdict]:
    """Run all velocities."""
    work = [
        Task(robot, direction, speed, seed, perturbed, seconds)
        for seed in range(seeds)
        for direction, speeds in speeds_of(robot, bundle).items()
        for speed in speeds
        for perturbed in (False, True)
    ]
    # Each run has a processor to itself; children that are spawned read this before numpy.
    os.environ |= {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    rows: list[Row] = []
    with ProcessPoolExecutor(jobs, get_context("spawn")) as pool, Progress(console=Console(stderr=True)) as progress:
        bar = progress.add_task("runs", total=len(work))
        for future in as_completed([pool.submit(run, task, bundle) for task in work]):
            rows.append(future.result())
            progress.advance(bar)
    rows.sort(key=lambda row: (row.direction, row.speed, row.seed, row.perturbed))
    Console(width=120).print(table(rows))
    if csv_out is not None:
        write_csv(csv_out, [asdict(row) for row in rows])
    return verdicts(rows, robot, bundle)


if __name__ == "__main__":
    benchmark(main)
