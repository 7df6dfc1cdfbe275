"""Does the robot do what makes a kind of motion, of each kind that the model offers?

Every kind that the bundle offers is asked for once a seed, in its first wording, through the whole live system, in
lockstep, nominal. The true motion of the parts that make the kind is compared with the human's of the same run
(`shared/robot_judge.py`): a robot that stays up and makes enough of it has done it. With `--write` the robot's folder
gets the figure of each kind (`repertoire.yaml`); a kind below `OFFERED` is refused by name at this robot from then on.
What was judged before does not count: every kind is asked for. The human is slowed to the robot's pace first: what that
makes another kind, such as a run a walk, is judged as that one, and the figures say so.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from rich.console import Console
from rich.table import Table

from benchmarks.robot.model_run import follow, sampler_of
from benchmarks.robot.simulation import HEAVY_KG
from benchmarks.shared.cells import cell
from benchmarks.shared.options import BundleOption, CsvOption, JobsOption
from benchmarks.shared.outcome import Outcome, Verdict, write_csv
from benchmarks.shared.processes import in_order
from benchmarks.shared.robot_judge import LEAST, LIKE, STROKES_LEAST, STROKES_LIKE, Done, deciding
from benchmarks.shared.robot_motion import parts_of
from flexmotion.bundles.repertoire import offered_kinds, robot_repertoire
from flexmotion.configs.errors import ConfigError
from flexmotion.configs.judged import Judged
from flexmotion.configs.repertoire import FILE, judging, write_repertoire
from flexmotion.configs.robot import load_robot
from flexmotion.sampling.condition import Condition
from flexmotion.sampling.pace import Pace
from flexmotion.sampling.sampler import Sampler
from flexmotion.streamer.motion.intents import Text
from flexmotion.streamer.motion.model_source import ModelSource
from flexmotion.streamer.motion.robot_pace import human_pace
from flexmotion.streamer.motion.script import Item
from flexmotion.text.phrases import STAND, wordings
from flexmotion.text.vocabulary import vocabulary

NAME = "robot/kinds"
OFFERED = 0.8
"""Share of runs from which on a kind is offered."""
GESTURE_S, LOCOMOTION_S = 6.0, 8.0
"""Length of a run of a gesture, and of locomotion."""


@dataclass(frozen=True)
class Task:
    """One run: a kind of motion, the seed of model and simulation, and what `load_robot` takes."""

    kind: str
    seed: int
    robot: str


@dataclass(frozen=True)
class Ran:
    """One run, judged.

    Attributes:
        done: how the robot made the part that decides.
        done_as: the kind that the robot's pace makes of it; None: it stays what it is.
    """

    kind: str
    seed: int
    upright: bool
    done: Done
    done_as: str | None = None

    @property
    def makes(self) -> bool:
        """Whether the robot did it and stayed up."""
        return self.upright and self.done.makes


def run(task: Task, bundle: Path | None) -> Ran:
    """Run and judge one kind.

    Raises:
        ConfigError: no wording of the kind is heard as it.
    """
    robot, sampler = load_robot(task.robot), sampler_of(bundle)
    table = vocabulary().table
    seconds = LOCOMOTION_S if task.kind in table["walks"] or task.kind in table["turns"] else GESTURE_S
    pace = human_pace(robot, sampler.body)
    source = _source(task, bundle, seconds, pace)
    found = follow(robot, source, False, task.seed, HEAVY_KG)
    assert found.human is not None  # of words without an amount
    done = deciding(task.kind, parts_of(task.kind, robot, found.record, found.human))
    upright = not found.report.motion.fell and not found.report.safety.faults
    return Ran(task.kind, task.seed, upright, done, made_by_pace(sampler, source.heard_items[0].asked, pace))


def made_by_pace(sampler: Sampler, words: str, pace: Pace | None) -> str | None:
    """The kind of motion that a pace makes of a straight one; None: none other.

    Beyond the pace a velocity replaces words of another gait, and is said to the model in words of its own.
    """
    own, slowed = (sampler.requests.meant(Condition(words, pace=one)) for one in (None, pace))
    if slowed.velocity is None or slowed.velocity[2]:
        return None
    told = sampler.requests.words_kind(slowed)
    return told if told != sampler.requests.words_kind(own) else None


def _source(task: Task, bundle: Path | None, seconds: float, pace: Pace | None) -> ModelSource:
    """The first wording of a kind that is heard as it, and has no end of its own."""
    for wording in wordings(task.kind):
        source = ModelSource(sampler_of(bundle), [Item(0.0, Text(wording))], wording, task.seed, seconds, pace)
        if source.heard_items[0].heard_as == task.kind and not source.is_measured:
            return source
    raise ConfigError(f"{task.kind}: none of its wordings is heard as it: {', '.join(wordings(task.kind))}")


def figures_of(runs: Sequence[Ran]) -> dict[str, dict[str, Any]]:
    """Of each kind: runs, share of them in which it was done, and the least of every figure over its runs."""
    of: dict[str, list[Ran]] = defaultdict(list)
    for one in runs:
        of[one.kind].append(one)
    return {
        kind: {
            "runs": len(own),
            "upright": float(np.mean([one.upright for one in own])),
            "did": float(np.mean([one.makes for one in own])),
            **{name: _least([getattr(one.done, name) for one in own]) for name in Done.__dataclass_fields__},
            "done_as": own[0].done_as,
        }
        for kind, own in of.items()
    }


def _least(values: Sequence[float | None]) -> float | None:
    return min((one for one in values if one is not None), default=None)


def judged_of(figures: Mapping[str, Mapping[str, Any]]) -> dict[str, Judged]:
    """The figures that a robot's folder gets."""
    return {
        kind: Judged(judge=NAME, samples=own["runs"], share=own["did"], least=OFFERED) for kind, own in figures.items()
    }


def table_of(figures: Mapping[str, Mapping[str, Any]]) -> Table:
    """One row a kind."""
    table = Table(
        title="Kinds at the robot: runs that did; least over the runs: share of the human's, cosine; of strokes"
    )
    for name in ("kind", "as", "runs", "upright", "did", "made", "like", "strokes", "like"):
        table.add_column(name)
    for kind, own in figures.items():
        shares = (f"{100 * own[name]:.0f} %" for name in ("upright", "did"))
        cells = (cell(own[name]) for name in Done.__dataclass_fields__)
        table.add_row(kind, own["done_as"] or "", str(own["runs"]), *shares, *cells)
    return table


def main(
    robot: Annotated[str, typer.Option("--robot", help="A shipped robot's name, or a folder.")] = "op3",
    bundle: BundleOption = None,
    seeds: Annotated[int, typer.Option(min=1, help="Runs of each kind.")] = 5,
    seed: Annotated[int, typer.Option(min=0, help="Of the first run; 0 and 1000 have chosen the limits.")] = 2000,
    kind: Annotated[list[str] | None, typer.Option(help="Only this kind; may be given again.")] = None,
    jobs: JobsOption = 1,
    csv_out: CsvOption = None,
    write: Annotated[
        bool, typer.Option("--write", help="Write the figures into the robot's folder: it then offers what passed.")
    ] = False,
) -> Outcome:
    """Run every kind and judge."""
    chosen = load_robot(robot)
    known = [one for one in offered_kinds(sampler_of(bundle).bundle) if one != STAND]
    if unknown := set(kind or ()) - set(known):
        raise ConfigError(f"unknown kinds {', '.join(sorted(unknown))}, expected some of: {', '.join(known)}")
    if kind and write and robot_repertoire(chosen) is None:
        raise ConfigError(
            f"{chosen.folder} has no {FILE}: with --kind and --write alone it would refuse every other kind; judge all "
            f"first: {judging(chosen.place)}"
        )
    tasks = [Task(one, seed + number, robot) for one in kind or known for number in range(seeds)]
    runs = in_order(partial(run, bundle=bundle), tasks, jobs)
    figures = figures_of(runs)
    Console(width=120).print(table_of(figures))
    judged, done_as = judged_of(figures), {one: own["done_as"] for one, own in figures.items() if own["done_as"]}
    if write:
        typer.echo(f"written: {write_repertoire(chosen, judged, done_as)}")
    if csv_out is not None:
        rows = [{"kind": one.kind, "seed": one.seed, "upright": one.upright, **asdict(one.done)} for one in runs]
        write_csv(csv_out, rows)
    refused = [f"{one} ({100 * own.share:.0f} %)" for one, own in judged.items() if not own.passed]
    if done_as:
        typer.echo(f"by its pace: {', '.join(f'{one} as {other}' for one, other in done_as.items())}")
    typer.echo(f"not done, {len(refused)}: {', '.join(refused)}" if refused else "all are done")
    fell = sum(not one.upright for one in runs)
    verdicts = [Verdict(f"upright: {len(runs) - fell} of {len(runs)} (all)", not fell)]
    limits = {"share": LEAST, "like": LIKE, "strokes": STROKES_LEAST, "strokes_like": STROKES_LIKE, "runs": OFFERED}
    done = [one for one, own in judged.items() if own.passed]
    return Outcome(
        verdicts, {"robot": chosen.name, "limits": limits, "done": done, "done_as": done_as, "by_kind": figures}
    )
