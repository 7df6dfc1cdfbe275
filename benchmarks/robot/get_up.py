"""Does a fallen robot get up from its front and from its back, on request?

Robots that stand in poses drawn at random are pushed over, give way and lie without torque, or collapse limp as their
torque is cut; each is then asked to get up, in the control loop with its clamps. Their masses, friction, stiffness,
supply and latency are drawn too (`benchmarks/shared/fallen.py`). The starts are others than those that `--tune` uses.
"""

from __future__ import annotations

from dataclasses import asdict
from functools import partial
from itertools import product
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from rich.console import Console
from rich.table import Table

from benchmarks.shared.fallen import Fallen, GotUp, way_to_lie
from benchmarks.shared.get_up_poses import write_get_up
from benchmarks.shared.options import CsvOption, JobsOption
from benchmarks.shared.outcome import Outcome, Verdict, write_csv
from benchmarks.shared.processes import in_order
from flexmotion.configs.errors import ConfigError
from flexmotion.configs.get_up import SIDES
from flexmotion.configs.robot import load_robot
from flexmotion.configs.stream import load_stream
from flexmotion.retarget.retargeter import Retargeter

REPORTED_SEED, TUNED_SEED = 10_000, 0
"""First seed of the starts that are reported, and of those that are tuned on."""
BATCH = 5
"""Starts in a process, which makes one retargeter."""


def attempts(task: tuple[str, bool, int, int], robot_name: str) -> list[GotUp]:
    """Let robots fall to a side and get up; those that come to lie on another side are not asked.

    Args:
        task: side, whether they collapse limp, first seed, number of robots that are to lie on it.
    """
    side, limp, seed, count = task
    robot = load_robot(robot_name)
    retargeter, found = Retargeter(robot, load_stream()), list[GotUp]()
    for number in range(seed, seed + 20 * count):
        one = Fallen(robot, retargeter, side, number, limp=limp)
        one.fall()
        if one.lies_on == side:
            found.append(one.get_up())
        if len(found) == count:
            break
    return found


def table(groups: dict[str, list[GotUp]]) -> Table:
    """One row a side and way to fall."""
    heads = "time [s]", "peak torque [N·m]", "over usable", "RMS over usable", "violations"
    out = Table("lay on its", "stands", "asked again", *heads)
    for side, group in groups.items():
        out.add_row(
            side,
            f"{sum(one.stood for one in group)} of {len(group)}",
            str(sum(one.asked > 1 for one in group)),
            f"{np.median([one.seconds for one in group]):.1f}",
            f"{max(one.peak_nm for one in group):.2f}",
            f"{max(one.peak_share for one in group):.2f}",
            f"{max(one.rms_share for one in group):.2f}",
            str(sum(one.violations for one in group)),
        )
    return out


def main(
    robot: Annotated[str, typer.Option(help="Name or folder of the robot.")] = "op3",
    starts: Annotated[int, typer.Option(min=1, help="Robots that get up, a side.")] = 20,
    sides: Annotated[list[str] | None, typer.Option("--side", help="Only this side (repeatable).")] = None,
    tune_to: Annotated[
        Path | None,
        typer.Option("--tune", help="Tune the poses instead, and write them to this file; its state lies beside it."),
    ] = None,
    minutes: Annotated[float, typer.Option(min=0.1, help="How long a side is tuned; again goes on.")] = 20.0,
    jobs: JobsOption = 2,
    csv_out: CsvOption = None,
) -> Outcome:
    """Let robots fall and get up, or tune how they do."""
    chosen = load_robot(robot)
    names: list[str] = [side for side in SIDES if side in chosen.get_up.steps and (sides is None or side in sides)]
    if not names:
        raise ConfigError(
            f"{robot}: no steps for {', '.join(sides or SIDES)}; it has: {', '.join(chosen.get_up.steps)}"
        )
    if tune_to is not None:
        from benchmarks.shared.get_up_tuning import tune

        tuned = dict(chosen.get_up.steps)
        for side in names:
            tuned[side] = tune(chosen, side, TUNED_SEED, minutes, tune_to.with_suffix(f".{side}.state"))
        write_get_up(chosen, tuned, tune_to)
        return Outcome()
    ways = list(product(names, (False, True)))
    tasks = [
        (side, limp, REPORTED_SEED + 1000 * first, min(BATCH, starts - first))
        for side, limp in ways
        for first in range(0, starts, BATCH)
    ]
    done = [one for found in in_order(partial(attempts, robot_name=robot), tasks, jobs) for one in found]
    groups = {way: [one for one in done if one.way == way] for way in (way_to_lie(*one) for one in ways)}
    console = Console()
    console.print(table(groups))
    for one in done:
        if not one.stood:
            console.print(f"{one.way}, seed {one.seed}: {one.reason}")
    if csv_out is not None:
        write_csv(csv_out, [asdict(one) for one in done])
    figures, verdicts = {}, []
    for side, group in groups.items():
        stand = sum(one.stood for one in group)
        figures[side] = {
            "starts": float(len(group)),
            "stand": float(stand),
            "asked_again": float(sum(one.asked > 1 for one in group)),
            "median_s": float(np.median([one.seconds for one in group])),
            "peak_nm": max(one.peak_nm for one in group),
            "peak_over_usable": max(one.peak_share for one in group),
            "rms_over_usable": max(one.rms_share for one in group),
            "violations": float(sum(one.violations for one in group)),
        }
        verdicts.append(Verdict(f"gets up from its {side}: {stand} of {starts} (all)", stand == starts))
    outside = sum(one.violations for one in done)
    verdicts.append(Verdict(f"goals outside the envelope: {outside} (0)", outside == 0))
    return Outcome(verdicts, figures)
