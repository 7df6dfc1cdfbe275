"""What does each part of the autoencoder's training contribute, one factor at a time?

Reduced autoencoders (`--width`, `--layers`, `--steps`) are trained with several seeds, as configured and with one
thing changed: without a group of losses, with the physics losses weighted from none to twice, with a narrower and a
wider latent, without principal components. Judged are reconstructions of held-out windows. TRAINING is a run of
`flexmotion train` with features (muscles included), text and evaluator, or a weights file with them, to which `--set`
gives the data; data, configuration and judge come from it. A run that was stopped continues when it is started again.
What no latent at all and fewer steps of sampling do is in `model/baselines`. Fails where the physics losses do not
improve their own metrics by 20 %, or where the Fréchet distance with all losses is more than 1.1 times that without one
of them.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated

import torch
import typer
from rich.console import Console
from rich.progress import track
from rich.table import Table

from benchmarks.model.reduced import mean_ratio, small
from benchmarks.shared.linked_run import linked_run
from benchmarks.shared.options import CsvOption
from benchmarks.shared.outcome import Outcome, Verdict, write_csv
from benchmarks.shared.training_folder import training_folder
from flexmotion.bundles.bundle import sha256
from flexmotion.configs.errors import ConfigError
from flexmotion.configs.model import LossWeights, ModelConfig
from flexmotion.evaluation.interval import Interval
from flexmotion.human.body import Body
from flexmotion.training.autoencoder import Autoencoder
from flexmotion.training.autoencoder_task import AutoencoderTask, load_autoencoder
from flexmotion.training.evaluate import Features, Generator, Judge
from flexmotion.training.processes import Processes, use_threads
from flexmotion.training.run import Run
from flexmotion.training.stage import train_stage

ALL = "as configured"
EULER, MUSCLES = ("euler_joints", "euler_root"), ("muscle_limits", "muscle_torques")


@dataclass(frozen=True)
class Cell:
    """One change of the configuration.

    Attributes:
        losses: factors on weights of losses.
        latent: factor on the size of the latent.
        shortcut: whether principal components are added where the configuration has them.
    """

    losses: Mapping[str, float]
    latent: float = 1.0
    shortcut: bool = True

    def of(self, config: ModelConfig) -> ModelConfig:
        """The changed configuration."""
        latent = config.autoencoder.latent
        changed = {name: getattr(config.losses, name) * factor for name, factor in self.losses.items()}
        shape = {"latent": round(self.latent * latent), "shortcut": config.autoencoder.shortcut and self.shortcut}
        return config.model_copy(
            update={
                "losses": config.losses.model_copy(update=changed),
                "autoencoder": config.autoencoder.model_copy(update=shape),
            }
        )


def _factor(names: tuple[str, ...], factor: float) -> Cell:
    return Cell(dict.fromkeys(names, factor))


CELLS: dict[str, Cell] = {
    ALL: Cell({}),
    "without Euler": _factor(EULER, 0.0),
    "without muscles": _factor(MUSCLES, 0.0),
    "without physics": _factor(EULER + MUSCLES, 0.0),
    "physics x 0.5": _factor(EULER + MUSCLES, 0.5),
    "physics x 2": _factor(EULER + MUSCLES, 2.0),
    "without path and points": _factor(("path", "points"), 0.0),
    "without change": _factor(("change",), 0.0),
    "latent / 3": Cell({}, latent=1 / 3),
    "latent x 2": Cell({}, latent=2.0),
    "without components": Cell({}, shortcut=False),
}
"""The cells; with three seeds each an evening's work on one core."""

OWN = {"without Euler": ("euler_force", "euler_moment", "actuation"), "without muscles": ("muscle_limit",)}
"""Metrics that the losses which a cell leaves out must improve."""

SHOWN = (
    "contact_force",
    "actuation",
    "euler_force",
    "euler_moment",
    "muscle_limit",
    "muscle_torque",
    "fid",
    "skate_ratio",
    "jerk",
)
IMPROVED, WORSE = 0.8, 1.1
FIGURES = "figures.json"


@dataclass(frozen=True)
class Reduction:
    """Size of the networks, and steps of training."""

    width: int
    layers: int
    steps: int

    def of(self, config: ModelConfig) -> ModelConfig:
        """The reduced configuration."""
        network = small(self.width, self.layers)
        stage = config.stages.autoencoder.model_copy(update={"steps": self.steps, "validate_every": self.steps})
        losses: LossWeights = config.losses.model_copy(update={"physics_from": self.steps // 4})
        return config.model_copy(
            update={
                "autoencoder": config.autoencoder.model_copy(update={"encoder": network, "decoder": network}),
                "losses": losses,
                "stages": config.stages.model_copy(update={"autoencoder": stage}),
            }
        )


def cell_run(training: Run, out: Path, name: str, seed: int, reduction: Reduction) -> Run:
    """The run of one cell and seed: a new one, or one that continues."""
    folder = out / f"{name.replace(' ', '-').replace('/', 'over')}-{seed}"
    return linked_run(training, folder, CELLS[name].of(reduction.of(training.config)), seed, ("features", "text"))


def reconstructed(judge: Judge, network: Autoencoder) -> Generator:
    """Generator of an autoencoder's reconstructions of the cases."""
    statistics = judge.store.statistics

    def generate(case: int, seed: int) -> Features:
        frames = (judge.cases.history[case], judge.cases.future[case])
        history, future = (torch.from_numpy(statistics.normalise(part))[None] for part in frames)
        with torch.no_grad():
            decoded = network.decode(history, network.encode(history, future)[0])
        return statistics.restore(decoded[0].numpy())

    return generate


def measured(judge: Judge, run: Run) -> dict[str, float]:
    """Every metric of one cell and seed."""
    task = AutoencoderTask(run.config, run.store(), run.seed, Processes(), run.muscles())
    train_stage(task, run.config.stages.autoencoder, run.stage("autoencoder"), fingerprint=run.fingerprint())
    found = judge.measure(reconstructed(judge, load_autoencoder(run).eval()))
    return {name: value.mean for name, value in found.items()}


def table(figures: dict[str, list[dict[str, float]]]) -> Table:
    """One line a cell, with intervals over the seeds."""
    shown = [name for name in SHOWN if all(name in row for rows in figures.values() for row in rows)]
    out = Table("cell", *shown, title="Reconstructions, one factor at a time")
    for cell, rows in figures.items():
        out.add_row(cell, *(str(Interval.of([row[name] for row in rows])) for name in shown))
    return out


def verdicts(figures: dict[str, list[dict[str, float]]]) -> list[Verdict]:
    """The criteria."""
    found = []
    for cell, metrics in OWN.items():
        for name in metrics:
            value = mean_ratio(figures[ALL], figures[cell], name)
            found.append(Verdict(f"{name} with all over {cell}: {value:.2f} (<= {IMPROVED})", value <= IMPROVED))
        value = mean_ratio(figures[ALL], figures[cell], "fid")
        found.append(Verdict(f"fid with all over {cell}: {value:.2f} (<= {WORSE})", value <= WORSE))
    return found


def main(
    training: Annotated[Path, typer.Argument(metavar="TRAINING", help="Training run with the data and the judge.")],
    out: Annotated[Path, typer.Argument(metavar="OUT", help="Folder for the runs; an unfinished one continues.")],
    data: Annotated[Path | None, typer.Option("--set", help="Training set, where TRAINING is a weights file.")] = None,
    seeds: Annotated[int, typer.Option(min=1, help="Of each cell.")] = 3,
    steps: Annotated[int, typer.Option(min=1, help="Of each autoencoder.")] = 1000,
    width: Annotated[int, typer.Option(min=4, help="Of the networks.")] = 96,
    layers: Annotated[int, typer.Option(min=1, help="Of each network.")] = 2,
    windows: Annotated[int, typer.Option(min=64, help="Held-out windows.")] = 512,
    threads: Annotated[int, typer.Option(min=1, help="Of the CPU.")] = 1,
    csv_out: CsvOption = None,
) -> Outcome:
    """Train with one thing changed at a time, and measure the reconstructions."""
    use_threads(threads)
    source, console = training_folder(training, out / "training", data, ["evaluator"], muscles=True), Console(width=200)
    if not source.layout.muscles:
        raise ConfigError(f"{training}: has no muscles, so their losses cannot be measured")
    reduction = Reduction(width, layers, steps)
    judge = Judge(source, source.summary().with_proportions(Body()), windows)
    figures: dict[str, list[dict[str, float]]] = {name: [] for name in CELLS}
    judged_by = {name: sha256(source.folder / name) for name in ("features/index.json", "evaluator/best.pt")}
    settings = asdict(reduction) | {"windows": windows} | judged_by
    cells = [(name, seed) for seed in range(seeds) for name in CELLS]
    for name, seed in track(cells, "cells", transient=True):
        run = cell_run(source, out, name, seed, reduction)
        path, own = run.folder / FIGURES, settings | {"losses": run.config.losses.model_dump()}
        done = json.loads(path.read_text(encoding="utf-8")) if path.is_file() else {}
        if done.get("settings") != own:
            done = {"settings": own, "figures": measured(judge, run)}
            path.write_text(json.dumps(done, indent=1), encoding="utf-8")
        figures[name].append(done["figures"])
    console.print(table(figures))
    console.print(f"autoencoders of {layers} + {layers} layers x {width}, {steps} steps; {seeds} seeds")
    if csv_out is not None:
        write_csv(csv_out, [{"cell": name, **row} for name, rows in figures.items() for row in rows])
    means = {
        name: {metric: sum(row[metric] for row in rows) / len(rows) for metric in SHOWN if metric in rows[0]}
        for name, rows in figures.items()
    }
    return Outcome(verdicts(figures), means)
