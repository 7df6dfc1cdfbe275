"""`flexmotion evaluate`: metrics of bundles on held-out clips."""

from __future__ import annotations

import shlex
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.table import Table

from flexmotion.streamer.commands.options import JsonOption
from flexmotion.streamer.commands.output import print_json, print_note, print_result, progress_bar
from flexmotion.streamer.commands.train import needs_training

if TYPE_CHECKING:
    from flexmotion.evaluation.interval import Interval
    from flexmotion.sampling.sampler import Sampler
    from flexmotion.training.evaluate import Judge

    Row = dict[str, Interval] | str


def evaluate(
    training: Annotated[
        Path,
        typer.Argument(
            metavar="TRAINING|WEIGHTS",
            help="Folder that `train` wrote or file of `export --weights`, evaluator included.",
        ),
    ],
    bundles: Annotated[list[Path], typer.Option("--bundle", "-b", help="Bundle to evaluate; repeatable.")],
    windows: Annotated[int, typer.Option("--windows", min=64, help="Number of held-out windows.")] = 1024,
    steps: Annotated[int | None, typer.Option("--steps", min=1, help="Steps of a sample.", show_default=False)] = None,
    seed: Annotated[int, typer.Option("--seed", min=0, help="Seed of windows and samples.")] = 0,
    data: Annotated[
        Path | None,
        typer.Option(
            "--set",
            help="Set with held-out clips; a weights file needs it, else real motion is rounded.",
            show_default=False,
        ),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option("--out", "-o", help="With a weights file: folder for the set's features.", show_default=False),
    ] = None,
    conditions: Annotated[
        str | None,
        typer.Option(
            "--conditions",
            metavar="all|NAMES",
            help="Instead: what single bundles make of joints, torques, forces and muscles that are asked; names with "
            "commas.",
            show_default=False,
        ),
    ] = None,
    table: Annotated[
        Path | None,
        typer.Option("--table", help="Write the table with command, seed and date, as Markdown.", show_default=False),
    ] = None,
    card: Annotated[bool, typer.Option("--card", help="Write the figures into the cards of the bundles.")] = False,
    as_json: JsonOption = False,
) -> None:
    """Compare models with real motion, the nearest training window and a motionless pose, by every metric.

    [bold]Examples[/bold]

      flexmotion evaluate training --bundle bundle

      flexmotion evaluate released.safetensors --set set -o evaluation --bundle bundle

      flexmotion evaluate training --set set --bundle bundle --conditions all --table conditions.md
    """
    needs_training()
    asked = _asked_conditions(conditions)
    if asked is not None and (card or len(bundles) > 1):
        raise typer.BadParameter("--conditions is of one bundle, and not for its card")
    from flexmotion.bundles.bundle import Bundle
    from flexmotion.bundles.card import add_figures
    from flexmotion.dataset.compact_set import open_set
    from flexmotion.evaluation.figure_table import condition_table, metric_table
    from flexmotion.sampling.sampler import Sampler
    from flexmotion.training.evaluate import Judge
    from flexmotion.training.release import begin_run
    from flexmotion.training.run import Run

    if training.is_file():
        if data is None or out is None:
            raise typer.BadParameter(f"{training}: a weights file has no clips; give --set and -o")
        run = begin_run(training, out, ["evaluator"])
        with progress_bar("computes features") as progress:
            run.store(data, progress)
    else:
        run = Run(training)
    samplers: dict[str, Sampler] = {}
    for path in bundles:
        sampler = Sampler(Bundle(path), steps)
        # The folder's name alone: cards are read on other machines.
        name = f"{path.resolve().name}, {sampler.steps} steps"
        samplers[name if name not in samplers else str(path)] = sampler
    bodies = {sampler.body for sampler in samplers.values()}
    if len(bodies) > 1:
        raise typer.BadParameter("the bundles are of humans of different size; evaluate them one by one")
    judge = Judge(run, bodies.pop(), windows, seed, None if data is None else open_set(data))
    if asked is None:
        figures = _of_models(judge, samplers)
        rows: dict[str, Row] = dict(figures)
        made = metric_table(figures)
    else:
        rows = _of_conditions(judge, next(iter(samplers.values())), asked, seed)
        made = condition_table(rows)
    if card:
        for path in bundles:
            add_figures(path, made.markdown)
    note = f"{len(judge.cases)} held-out windows at {judge.layout.fps:g} fps; heights are of heels and toes"
    if table is not None:
        names = ", ".join(f"{name}, {sampler.bundle.hash}" for name, sampler in samplers.items())
        made.write(table, _command(training, bundles, conditions), f"{note}. Seed {seed}. Bundle: {names}.")
    if as_json:
        models = {
            name: {"refused": row} if isinstance(row, str) else {metric: asdict(value) for metric, value in row.items()}
            for name, row in rows.items()
        }
        print_json({"windows": len(judge.cases), "fps": judge.layout.fps, "heights": "heel and toe", "models": models})
        return
    printed = Table(*made.headings)
    for line in made.lines:
        printed.add_row(*line)
    print_result(printed)
    print_note(note)


def _of_models(judge: Judge, samplers: Mapping[str, Sampler]) -> dict[str, dict[str, Interval]]:
    """Figures of the models beside what they are compared with."""
    generators = {"real": judge.real, "motionless": judge.motionless, "nearest": judge.nearest()}
    generators |= {name: judge.sampled(sampler) for name, sampler in samplers.items()}
    figures = {}
    with progress_bar("evaluates") as progress:
        for number, (name, generator) in enumerate(generators.items()):
            figures[name] = judge.measure(generator, judge.delivered(samplers[name]) if name in samplers else None)
            progress((number + 1) / len(generators))
    return figures


def _of_conditions(judge: Judge, sampler: Sampler, names: Sequence[str], seed: int) -> dict[str, Row]:
    """Figures of real motion, and of a model's under each condition."""
    from flexmotion.training.condition_rows import ConditionRows

    rows: dict[str, Row] = {"real": judge.measure(judge.real)}
    with progress_bar("evaluates") as progress:
        for number, (name, row) in enumerate(ConditionRows(judge, sampler, seed).rows(names)):
            rows[name] = row
            progress((number + 1) / (len(names) + 1))
    return rows


def _asked_conditions(given: str | None) -> list[str] | None:
    """Names of conditions, all of them for `all`."""
    from flexmotion.training.condition_rows import CONDITIONS

    if given is None or given == "all":
        return None if given is None else list(CONDITIONS)
    names = [name.strip() for name in given.split(",")]
    if unknown := [name for name in names if name not in CONDITIONS]:
        expected = ", ".join(CONDITIONS)
        raise typer.BadParameter(f"no condition {unknown[0]!r}; expected all, or names among: {expected}")
    return names


def _command(training: Path, bundles: Sequence[Path], conditions: str | None) -> str:
    """The command that makes a table again; folders of this machine are left out."""
    parts = ["flexmotion", "evaluate", training.name]
    parts += [part for path in bundles for part in ("--bundle", path.resolve().name)]
    return shlex.join(parts + ([] if conditions is None else ["--conditions", conditions]))
