"""Does the robot go as far and turn as much in a minute as it is asked to by a velocity?

In lockstep, nominal and perturbed, at the simulated robot's true pose. A velocity of the robot's size is asked for as
an operator's stick asks; a run is judged from the ask to its end. "way" is the way of the torso along the asked
direction, in its own heading, over the asked way; "heading" how far it looks, at the end, from where the asked turn
leads, as a mean over 5 s; "aside" how far it is off the straight line, over the way, where no turn is asked.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from functools import partial
from typing import Annotated

import numpy as np
import typer
from rich.console import Console
from rich.table import Table

from benchmarks.robot.simulation import simulator
from benchmarks.robot.steering import asked_at, stays_upright, torso_yaw, way_along
from benchmarks.shared.cells import cell, middle
from benchmarks.shared.options import CsvOption, JobsOption
from benchmarks.shared.outcome import Outcome, Verdict, write_csv
from benchmarks.shared.processes import in_order
from flexmotion.configs.robot import load_robot
from flexmotion.human.body import Body
from flexmotion.streamer import api
from flexmotion.streamer.motion.intents import Velocity
from flexmotion.streamer.motion.robot_pace import human_scale

COURSES: dict[str, tuple[float, float, float]] = {
    "ahead .06 m/s": (0.06, 0.0, 0.0),
    "ahead .12 m/s": (0.12, 0.0, 0.0),
    "ahead .17 m/s": (0.17, 0.0, 0.0),
    "curve .12 m/s, .15 rad/s": (0.12, 0.0, 0.15),
    "left .03 m/s": (0.0, 0.03, 0.0),
    "right .03 m/s": (0.0, -0.03, 0.0),
    "turn left .3 rad/s": (0.0, 0.0, 0.3),
    "turn right .3 rad/s": (0.0, 0.0, -0.3),
}
"""What is asked, in the robot's size: forward, left [m/s], turning [rad/s]; within what OP3 does."""

STOOD_S = 3.0
LAST_S = 5.0
"""A walking torso turns by some degrees to each side: the heading at the end is a mean over this time [s]."""
WAY, HEADING_DEG = 0.1, 5.0


@dataclass(frozen=True)
class Task:
    """One run: the course, whether the robot is perturbed, the seed, and its length [s]."""

    course: str
    perturbed: bool
    seed: int
    seconds: float


@dataclass(frozen=True)
class Run:
    """What became of one.

    Attributes:
        way: along what was asked, over it; NaN where only a turn was asked.
        heading_deg: from where the asked turn leads [degrees].
        aside: off the line over the asked way; NaN in curves and turns.
        upright: the robot did not fall.
    """

    course: str
    perturbed: bool
    seed: int
    way: float
    heading_deg: float
    aside: float
    upright: bool


def drive(task: Task, robot_name: str) -> Run:
    """One run."""
    robot = load_robot(robot_name)
    ratio = human_scale(robot, Body())
    forward, left, turning = COURSES[task.course]
    wanted = Velocity(forward * ratio, left * ratio, turning)
    with api.open_session(robot, simulator(robot, task.perturbed, task.seed), seed=task.seed) as session:
        session.advance(STOOD_S)
        tick = session.state.tick
        session.send(wanted)
        session.advance(task.seconds)
        session.finish()
    record = session.record
    begin = int(np.searchsorted(record.ticks.tick, tick))
    rows = slice(begin, begin + round(task.seconds * record.rate_hz))
    base = record.true_base[rows]
    yaw = np.unwrap(torso_yaw(base))
    asked, last = asked_at(robot, wanted), round(LAST_S * record.rate_hz)
    seconds = np.arange(len(yaw)) / record.rate_hz
    speed = float(np.hypot(*asked[:2]))
    way = float(way_along(record, asked, rows)[0][-1]) / (speed * task.seconds) if speed else float("nan")
    moved, first = base[-1, :2] - base[0, :2], yaw[0] + np.arctan2(asked[1], asked[0])
    across = abs(float(moved @ [-np.sin(first), np.cos(first)]))
    straight = speed > 0.0 and not asked[2]
    return Run(
        task.course,
        task.perturbed,
        task.seed,
        way,
        float(np.degrees(np.mean(yaw[-last:] - yaw[0] - asked[2] * seconds[-last:]))),
        across / (speed * task.seconds) if straight else float("nan"),
        stays_upright(base),
    )


def main(
    seconds: Annotated[float, typer.Option(min=5.0, help="Length of a run [s].")] = 60.0,
    seeds: Annotated[int, typer.Option(min=1, help="Runs of each course, nominal and perturbed.")] = 1,
    only: Annotated[str, typer.Option(help="Courses whose names contain this.")] = "",
    robot: Annotated[str, typer.Option("--robot", help="Robot.")] = "op3",
    jobs: JobsOption = 1,
    csv_out: CsvOption = None,
) -> Outcome:
    """Ask for each course, and measure."""
    courses = [name for name in COURSES if only in name]
    tasks = [
        Task(name, perturbed, seed, seconds) for name in courses for perturbed in (False, True) for seed in range(seeds)
    ]
    found = in_order(partial(drive, robot_name=robot), tasks, jobs)
    table = Table("course", "robot", "way / asked", "heading [°]", "aside / way", "upright")
    for course in courses:
        for perturbed in (False, True):
            own = [run for run in found if (run.course, run.perturbed) == (course, perturbed)]
            cells = [" ".join(f"{getattr(run, name):{form}}" for run in own) for name, form in _COLUMNS]
            standing = f"{sum(run.upright for run in own)} of {len(own)}"
            table.add_row(course, "perturbed" if perturbed else "nominal", *cells, standing)
    Console(width=140).print(table)
    if csv_out is not None:
        write_csv(csv_out, [asdict(run) for run in found])
    return Outcome(verdicts(found), {"runs": [asdict(run) for run in found]})


_COLUMNS = (("way", ".2f"), ("heading_deg", ".1f"), ("aside", ".2f"))


def verdicts(found: list[Run]) -> list[Verdict]:
    """What must hold of all runs."""
    ways = [run.way for run in found if np.isfinite(run.way)]
    headings = [abs(run.heading_deg) for run in found]
    near = sum(abs(way - 1.0) <= WAY for way in ways)
    looking = sum(heading <= HEADING_DEG for heading in headings)
    fell = sum(not run.upright for run in found)
    return [
        Verdict(f"way within 10 %: {near} of {len(ways)} runs, median {cell(middle(ways))}", near == len(ways)),
        Verdict(
            f"heading within 5°: {looking} of {len(headings)} runs, median {cell(middle(headings), '.1f')}°",
            looking == len(headings),
        ),
        Verdict(f"falls: {fell} of {len(found)} (0)", fell == 0),
    ]
