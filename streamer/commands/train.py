"""`flexmotion train`: a training set to the networks of a model, stage by stage."""

from __future__ import annotations

import importlib.util
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from configs.errors import ConfigError
from streamer.commands.options import JsonOption
from streamer.commands.output import print_json, print_note, print_result, progress_bar

if TYPE_CHECKING:
    from flexmotion.training.run import Run
    from flexmotion.training.stage import Task

train = typer.Typer(help="Train a model, stage by stage; every stage goes on where it was stopped.")

OutOption = Annotated[Path, typer.Option("--out", "-o", help="Folder of the training; a new one or one to go on with.")]
SetOption = Annotated[
    Path | None, typer.Option("--set", help="Set that `data build` wrote; needed once.", show_default=False)
]
ConfigOption = Annotated[
    str | None,
    typer.Option("--config", help="stream, paper, or a YAML file; needed once.", show_default=False),
]
SeedOption = Annotated[
    int | None, typer.Option("--seed", min=0, help="Of everything; fixed at the first start.", show_default=False)
]
StepsOption = Annotated[
    int | None, typer.Option("--steps", min=1, help="Instead of the configuration's.", show_default=False)
]
MinutesOption = Annotated[
    float | None, typer.Option("--minutes", min=0.0, help="Stop after so long.", show_default=False)
]
ThreadsOption = Annotated[int | None, typer.Option("--threads", min=1, help="Of the CPU.", show_default=False)]


def needs_training() -> None:
    """Raise `ConfigError` where the libraries of training are not installed."""
    if importlib.util.find_spec("torch") is None:
        raise ConfigError("training needs the extra 'train': pip install 'flexmotion[train]'")


@train.command()
def autoencoder(
    out: OutOption,
    data: SetOption = None,
    config: ConfigOption = None,
    seed: SeedOption = None,
    steps: StepsOption = None,
    minutes: MinutesOption = None,
    threads: ThreadsOption = None,
    as_json: JsonOption = False,
) -> None:
    """Train the autoencoder: windows of all modalities to one latent vector and back.

    [bold]Examples[/bold]

      flexmotion train autoencoder --set set --config stream -o training
    """
    run = _run(out, config, seed, threads)
    with progress_bar("computes features") as progress:
        store = run.store(data, progress)
    from flexmotion.training.autoencoder_task import AutoencoderTask
    from flexmotion.training.processes import Processes

    _train(run, "autoencoder", AutoencoderTask(run.config, store, run.seed, Processes()), steps, minutes, as_json)


def _run(out: Path, config: str | None, seed: int | None, threads: int | None) -> Run:
    needs_training()
    import torch

    from flexmotion.training.run import Run

    if threads is not None:
        torch.set_num_threads(threads)
    return Run(out, config, seed)


def _train(run: Run, name: str, task: Task, steps: int | None, minutes: float | None, as_json: bool) -> None:
    from flexmotion.training.processes import Processes
    from flexmotion.training.stage import Progress, train_stage

    stage = getattr(run.config.stages, name)
    if steps is not None:
        stage = stage.model_copy(update={"steps": steps, "validate_every": min(stage.validate_every, steps)})
    shown: dict[str, float] = {}

    with progress_bar(f"trains {name}") as bar:

        def follow(progress: Progress) -> None:
            bar(progress.step / progress.steps)
            if progress.figures and progress.figures != shown:
                shown.clear()
                shown.update(progress.figures)
                print_note(f"step {progress.step}: {_figures(progress.figures)}")

        done = train_stage(
            task,
            stage,
            run.stage(name),
            fingerprint=run.fingerprint(),
            seconds=None if minutes is None else 60 * minutes,
            progress=follow,
            processes=Processes(),
        )
    if as_json:
        print_json({"stage": name, "step": done.step, "steps": done.steps, "validation": done.figures})
    else:
        print_result(f"{run.stage(name)}: step {done.step} of {done.steps}, {_figures(done.figures)}")


def _figures(figures: dict[str, float]) -> str:
    return ", ".join(f"{name} {value:.4g}" for name, value in figures.items())
