"""`flexmotion evaluate`: metrics of bundles on held-out clips."""

from __future__ import annotations

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
    card: Annotated[bool, typer.Option("--card", help="Write the figures into the cards of the bundles.")] = False,
    as_json: JsonOption = False,
) -> None:
    """Compare models with real motion, the nearest training window and a motionless pose, by every metric.

    [bold]Examples[/bold]

      flexmotion evaluate training --bundle bundle

      flexmotion evaluate released.safetensors --set set -o evaluation --bundle bundle
    """
    needs_training()
    from flexmotion.bundles.bundle import Bundle
    from flexmotion.bundles.card import add_figures
    from flexmotion.dataset.compact_set import open_set
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
    generators = {"real": judge.real, "motionless": judge.motionless, "nearest": judge.nearest()}
    generators |= {name: judge.sampled(sampler) for name, sampler in samplers.items()}
    figures: dict[str, dict[str, Interval]] = {}
    with progress_bar("evaluates") as progress:
        for number, (name, generator) in enumerate(generators.items()):
            figures[name] = judge.measure(generator, judge.delivered(samplers[name]) if name in samplers else None)
            progress((number + 1) / len(generators))
    if card:
        for path in bundles:
            add_figures(path, figures)
    if as_json:
        models = {name: {metric: asdict(value) for metric, value in row.items()} for name, row in figures.items()}
        print_json({"windows": len(judge.cases), "fps": judge.layout.fps, "heights": "heel and toe", "models": models})
    else:
        print_result(_table(figures))
        print_note(f"{len(judge.cases)} held-out windows at {judge.layout.fps:g} fps; heights are of heels and toes")


def _table(figures: dict[str, dict[str, Interval]]) -> Table:
    table = Table("metric", *figures)
    for metric in dict.fromkeys(name for row in figures.values() for name in row):
        table.add_row(metric, *(str(row.get(metric, "-")) for row in figures.values()))
    return table
