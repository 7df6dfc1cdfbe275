"""How long does a plan take, a whole one and the short one that a new target gets first?

Clips of a list are planned offline at the cadence of a live run; every plan is made again several times, whole and
short, and its least processor time counts: the machine's other work only adds to it. Prints milliseconds by kind of
motion. No limit is judged, since the machine decides; compare two versions by turns on the same one.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table
from threadpoolctl import threadpool_limits

from benchmarks.shared.clips import ClipList, extracted
from benchmarks.shared.outcome import Outcome
from flexmotion.configs.robot import Robot, load_robot
from flexmotion.configs.stream import load_stream
from flexmotion.importers.load import load
from flexmotion.retarget.plan import Plan
from flexmotion.retarget.retargeter import Retargeter
from flexmotion.streamer.motion.sources import ClipSource
from flexmotion.streamer.planning.planner import Planner

Float = NDArray[np.float64]

CLIPS = Path(__file__).parents[1] / "robot" / "few_clips.yaml"


def joins(planner: Planner, robot: Robot) -> Iterator[tuple[int, Plan | None]]:
    """The tick and the plan before of every plan that a run of the planner's source makes at its cadence."""
    cadence = round(planner.settings.replan_s * robot.rate_hz)
    join, current, over = 0, None, False
    while not over:
        yield join, current
        planned = planner.plan(join, current)
        over, current = planned.source_over, planned.plan
        join += cadence


def least_ms(planner: Planner, robot: Robot, repeats: int) -> Float:
    """Least processor time of every plan, whole and short, (N, 2) [ms]."""
    found = []
    for join, current in joins(planner, robot):
        least = [np.inf, np.inf]
        for _ in range(repeats):
            for place, partial in enumerate((False, True)):
                begin = time.process_time()
                planner.plan(join, current, partial=partial)
                least[place] = min(least[place], time.process_time() - begin)
        found.append(least)
    return 1e3 * np.array(found)


def main(
    clips: Annotated[Path, typer.Option(help="List of clips.")] = CLIPS,
    repeats: Annotated[int, typer.Option(min=1, help="How often each plan is made.")] = 5,
    robot_name: Annotated[str, typer.Option("--robot", help="Robot whose plans are made.")] = "op3",
) -> Outcome:
    """Measure the plans of every clip."""
    listed, robot, settings = ClipList(clips), load_robot(robot_name), load_stream()
    retargeter = Retargeter(robot, settings)
    kinds: dict[str, list[Float]] = {}
    with extracted(listed.by_collection) as folder, threadpool_limits(limits=1, user_api="blas"):
        for clip in listed.clips:
            planner = Planner(retargeter, ClipSource(load(folder / f"{clip.name}.bvh")), settings)
            kinds.setdefault(clip.kind, []).append(least_ms(planner, robot, repeats))
    table = Table(
        "motion", "plans", "whole p50 ms", "p90", "short p50 ms", "p90", title=f"Processor time, {robot.name}"
    )
    figures = {}
    every = {kind: np.concatenate(own) for kind, own in kinds.items()}
    for kind, took in (*every.items(), ("all", np.concatenate([*every.values()]))):
        cells = np.quantile(took, (0.5, 0.9), axis=0).T.ravel()
        table.add_row(kind, str(len(took)), *(f"{value:.1f}" for value in cells))
        names = ("whole_p50_ms", "whole_p90_ms", "short_p50_ms", "short_p90_ms")
        figures[kind] = dict(zip(names, map(float, cells), strict=True)) | {"plans": len(took)}
    Console(width=120).print(table)
    return Outcome(figures=figures)
