"""`flexmotion evaluate`: bundles against held-out clips."""

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
        Path, typer.Argument(metavar="TRAINING", help="Folder that `train` wrote, evaluator included.")
    ],
    bundles: Annotated[list[Path], typer.Option("--bundle", "-b", help="Bundle to evaluate; may be given again.")],
    windows: Annotated[int, typer.Option("--windows", min=64, help="Held-out windows.")] = 1024,
    steps: Annotated[int | None, typer.Option("--steps", min=1, help="Of the diffusion.", show_default=False)] = None,
    seed: Annotated[int, typer.Option("--seed", min=0, help="Of windows and samples.")] = 0,
    card: Annotated[bool, typer.Option("--card", help="Write the figures into the cards of the bundles.")] = False,
    as_json: JsonOption = False,
) -> None:
    """Compare models with real motion, the nearest training window and a motionless pose, by every metric.

    [bold]Examples[/bold]

      flexmotion evaluate training --bundle bundle
    """
    needs_training()
    from flexmotion.bundles.bundle import Bundle
    from flexmotion.bundles.card import add_figures
    from flexmotion.sampling.sampler import Sampler
    from flexmotion.training.evaluate import Judge
    from flexmotion.training.run import Run

    samplers: dict[str, Sampler] = {}
    for path in bundles:
        sampler = Sampler(Bundle(path), steps)
        # By its folder's name: cards are read on other machines.
        name = f"{path.resolve().name}, {sampler.steps} steps"
        samplers[name if name not in samplers else str(path)] = sampler
    bodies = {sampler.body for sampler in samplers.values()}
    if len(bodies) > 1:
        raise typer.BadParameter("the bundles are for humans of different size; evaluate them one by one")
    judge = Judge(Run(training), bodies.pop(), windows, seed)
    generators = {"real": judge.real, "motionless": judge.motionless, "nearest": judge.nearest()}
    generators |= {name: judge.sampled(sampler) for name, sampler in samplers.items()}
    figures: dict[str, dict[str, Interval]] = {}
    with progress_bar("evaluates") as progress:
        for number, (name, generator) in enumerate(generators.items()):
            figures[name] = judge.measure(generator)
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
