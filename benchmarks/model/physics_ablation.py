"""What do the physics losses contribute to a reduced model?

Trains it with all of them, and without each, with several seeds. TRAINING is a run of `flexmotion train` with features
(muscles included), text and evaluator; data, configuration and judge come from it. The networks are reduced
(`--width`, `--layers`), everything else is as configured. Judged are reconstructions of held-out windows by the
autoencoder; with `--diffusion-steps`, samples of a diffusion on top of it. A run that was stopped continues when it is
started again. Fails where a loss does not improve its own metrics by 20 %, or where the Fréchet distance with all of
them is more than 1.1 times that without one.
"""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from pathlib import Path
from shutil import copyfile
from typing import Annotated

import torch
import typer
import yaml
from rich.console import Console
from rich.table import Table

from benchmarks.model.reduced import mean_ratio, small
from benchmarks.shared.options import CsvOption
from benchmarks.shared.outcome import Outcome, Verdict, write_csv
from flexmotion.configs.errors import ConfigError
from flexmotion.configs.model import ModelConfig
from flexmotion.evaluation.interval import Interval
from flexmotion.human.body import Body
from flexmotion.sampling.sampler import Sampler
from flexmotion.text.sentence_encoder import SentenceEncoder
from flexmotion.training.autoencoder import Autoencoder
from flexmotion.training.autoencoder_task import AutoencoderTask, load_autoencoder
from flexmotion.training.diffusion_task import DiffusionTask
from flexmotion.training.evaluate import Features, Generator, Judge
from flexmotion.training.export import export
from flexmotion.training.processes import Processes, use_threads
from flexmotion.training.run import Run
from flexmotion.training.stage import Task, train_stage

ALL = "all"
WITHOUT = {"euler": ("euler_joints", "euler_root"), "muscles": ("muscle_limits", "muscle_torques")}
"""Losses that a variant leaves out together."""

OWN = {"euler": ("euler_force", "euler_moment", "actuation"), "muscles": ("muscle_limit",)}
"""Metrics that a loss must improve."""

SHOWN = ("contact_force", "actuation", "euler_force", "euler_moment", "muscle_limit", "muscle_torque", "fid", "jerk")
IMPROVED, WORSE = 0.8, 1.1
FIGURES = "figures.json"


@dataclass(frozen=True)
class Reduction:
    """Size of the networks, and steps of training."""

    width: int
    layers: int
    steps: int
    diffusion_steps: int

    def of(self, config: ModelConfig, variant: str) -> ModelConfig:
        """The reduced configuration of a variant."""
        network = small(self.width, self.layers)
        stages = {
            name: getattr(config.stages, name).model_copy(update={"steps": steps})
            for name, steps in (("autoencoder", self.steps), ("diffusion", max(self.diffusion_steps, 1)))
        }
        losses = dict.fromkeys(WITHOUT.get(variant, ()), 0.0) | {"physics_from": self.steps // 4}
        return config.model_copy(
            update={
                "autoencoder": config.autoencoder.model_copy(update={"encoder": network, "decoder": network}),
                "diffusion": config.diffusion.model_copy(update={"denoiser": network}),
                "losses": config.losses.model_copy(update=losses),
                "stages": config.stages.model_copy(update=stages),
            }
        )


def variant_run(training: Run, out: Path, variant: str, seed: int, reduction: Reduction) -> Run:
    """The run of one variant and seed: a new one, or one that continues."""
    folder = out / f"{'without-' * (variant in WITHOUT)}{variant}-{seed}"
    folder.mkdir(parents=True, exist_ok=True)
    wanted = folder / "wanted.yaml"
    content = reduction.of(training.config, variant).model_dump()
    wanted.write_text(yaml.safe_dump(content, sort_keys=False), encoding="utf-8")
    for name in ("features", "text"):
        if not (folder / name).exists():
            (folder / name).symlink_to((training.folder / name).resolve(), target_is_directory=True)
    fitted = training.folder / "muscle_torques.npz"
    if fitted.is_file():
        copyfile(fitted, folder / fitted.name)
    return Run(folder, str(wanted), seed)


def trained(run: Run, reduction: Reduction) -> None:
    """Train the stages of a run that are not finished."""
    task = AutoencoderTask(run.config, run.store(), run.seed, Processes(), run.muscles())
    _stage(run, "autoencoder", task)
    if reduction.diffusion_steps:
        encode = SentenceEncoder(run.stage("text"))
        _stage(
            run, "diffusion", DiffusionTask(run.config, run.store(), _autoencoder(run), encode, run.seed, Processes())
        )


def _stage(run: Run, name: str, task: Task) -> None:
    train_stage(task, getattr(run.config.stages, name), run.stage(name), fingerprint=run.fingerprint())


def _autoencoder(run: Run) -> Autoencoder:
    return load_autoencoder(run).eval()


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


def measured(judge: Judge, run: Run, reduction: Reduction, sampling_steps: int) -> dict[str, Interval]:
    """Every metric of one variant and seed."""
    if not reduction.diffusion_steps:
        return judge.measure(reconstructed(judge, _autoencoder(run)))
    bundle = export(run, run.folder / "bundle", distilled=False, body=Body())
    return judge.measure(judge.sampled(Sampler(bundle, sampling_steps)))


def table(figures: dict[str, list[dict[str, float]]]) -> Table:
    """Metrics with all losses and without each, with intervals over the seeds, and their ratios."""
    out = Table("metric", ALL, title="Physics losses")
    for variant in WITHOUT:
        out.add_column(f"without {variant}", justify="right")
        out.add_column("all / without", justify="right")
    for name in SHOWN:
        rows = {variant: [row[name] for row in own if name in row] for variant, own in figures.items()}
        if not all(rows.values()):
            continue
        cells = [str(Interval.of(rows[ALL]))]
        for variant in WITHOUT:
            cells += [str(Interval.of(rows[variant])), f"{ratio(figures, variant, name):.2f}"]
        out.add_row(name, *cells)
    return out


def ratio(figures: dict[str, list[dict[str, float]]], variant: str, name: str) -> float:
    """A metric with all losses over the same metric without some; 1 where both are 0."""
    return mean_ratio(figures[ALL], figures[variant], name)


def verdicts(figures: dict[str, list[dict[str, float]]]) -> list[Verdict]:
    """The criteria."""
    found = []
    for variant, metrics in OWN.items():
        for name in metrics:
            value = ratio(figures, variant, name)
            found.append(Verdict(f"{name} with over without {variant}: {value:.2f} (<= {IMPROVED})", value <= IMPROVED))
        value = ratio(figures, variant, "fid")
        found.append(Verdict(f"fid with over without {variant}: {value:.2f} (<= {WORSE})", value <= WORSE))
    return found


def main(
    training: Annotated[Path, typer.Argument(metavar="TRAINING", help="Training run with the data and the judge.")],
    out: Annotated[Path, typer.Argument(metavar="OUT", help="Folder for the runs; an unfinished one continues.")],
    seeds: Annotated[int, typer.Option(min=1, help="Of each variant.")] = 3,
    steps: Annotated[int, typer.Option(min=1, help="Of each autoencoder.")] = 3000,
    diffusion_steps: Annotated[int, typer.Option(min=0, help="Of each diffusion; 0: no diffusion.")] = 0,
    width: Annotated[int, typer.Option(min=4, help="Of the networks.")] = 96,
    layers: Annotated[int, typer.Option(min=1, help="Of each network.")] = 2,
    windows: Annotated[int, typer.Option(min=64, help="Held-out windows.")] = 512,
    sampling_steps: Annotated[int, typer.Option(min=1, help="Of a sample.")] = 10,
    threads: Annotated[int, typer.Option(min=1, help="Of the CPU.")] = 1,
    csv_out: CsvOption = None,
) -> Outcome:
    """Train with and without the physics losses, and measure the models."""
    use_threads(threads)
    source, console = Run(training), Console(width=160)
    if not source.layout.muscles:
        raise ConfigError(f"{training}: has no muscles, so their losses cannot be measured")
    reduction = Reduction(width, layers, steps, diffusion_steps)
    judge = Judge(source, source.summary().with_proportions(Body()), windows)
    figures: dict[str, list[dict[str, float]]] = {variant: [] for variant in (ALL, *WITHOUT)}
    settings = asdict(reduction) | {"windows": windows, "sampling_steps": sampling_steps}
    for seed in range(seeds):
        for variant, rows in figures.items():
            run = variant_run(source, out, variant, seed, reduction)
            path = run.folder / FIGURES
            done = json.loads(path.read_text(encoding="utf-8")) if path.is_file() else {}
            if done.get("settings") != settings:
                console.print(f"training {run.folder}")
                trained(run, reduction)
                found = {name: value.mean for name, value in measured(judge, run, reduction, sampling_steps).items()}
                done = {"settings": settings, "figures": found}
                path.write_text(json.dumps(done, indent=1), encoding="utf-8")
            rows.append(done["figures"])
    console.print(table(figures))
    console.print(f"autoencoders of {layers} + {layers} layers x {width}, {steps} steps; {seeds} seeds")
    if csv_out is not None:
        write_csv(csv_out, [{"variant": variant, **row} for variant, rows in figures.items() for row in rows])
    means = {
        variant: {name: sum(row[name] for row in rows) / len(rows) for name in rows[0]}
        for variant, rows in figures.items()
    }
    return Outcome(verdicts(figures), means)
