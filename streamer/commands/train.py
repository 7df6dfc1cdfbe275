"""`flexmotion train`: trains the networks of a model on a training set, stage by stage."""

from __future__ import annotations

import importlib.util
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Protocol

import typer

from flexmotion.configs.errors import ConfigError
from flexmotion.streamer.commands.options import JsonOption
from flexmotion.streamer.commands.output import print_json, print_result, progress_bar
from flexmotion.streamer.commands.stage_report import figures_text, train_and_report

if TYPE_CHECKING:
    from flexmotion.text.sentence_encoder import SentenceEncoder
    from flexmotion.training.diffusion_task import DiffusionTask
    from flexmotion.training.feature_store import FeatureStore
    from flexmotion.training.run import Run
    from flexmotion.training.stage import Task

train = typer.Typer(help="Train a model, stage by stage; a stopped stage resumes where it was.")

OutOption = Annotated[Path, typer.Option("--out", "-o", help="Folder of the training; a new one, or one to resume.")]
SetOption = Annotated[
    Path | None,
    typer.Option("--set", help="Training set of `data build` or `data export`; needed once.", show_default=False),
]
OnlyOption = Annotated[
    str | None,
    typer.Option(
        "--only",
        metavar="COLLECTIONS",
        help="With --set: clips of these collections alone, with commas; `commercial`: of those whose terms allow"
        " products.",
        show_default=False,
    ),
]
ConfigOption = Annotated[
    str | None,
    typer.Option("--config", help="stream, paper, or a YAML file; needed once.", show_default=False),
]
SeedOption = Annotated[
    int | None,
    typer.Option("--seed", min=0, help="Seed of all random numbers; fixed at the first start.", show_default=False),
]
StepsOption = Annotated[
    int | None,
    typer.Option("--steps", min=1, help="Steps of the optimiser, instead of the configuration's.", show_default=False),
]
MinutesOption = Annotated[
    float | None, typer.Option("--minutes", min=0.0, help="Stop after this time.", show_default=False)
]
ThreadsOption = Annotated[int | None, typer.Option("--threads", min=1, help="Threads of the CPU.", show_default=False)]


FromOption = Annotated[
    Path | None,
    typer.Option(
        "--from",
        metavar="WEIGHTS",
        help="Weights file of `export --weights` to go on from, in a new folder; needs --set there.",
        show_default=False,
    ),
]


def needs_training() -> None:
    """Raise `ConfigError` where the libraries of the extra `train` are not installed."""
    needed = ("onnx", "onnxscript", "safetensors", "sklearn", "torch")
    if any(importlib.util.find_spec(name) is None for name in needed):
        raise ConfigError("training needs the extra 'train': in a clone, pip install '.[train]'")


class Finish(Protocol):
    """Trains a stage's task and prints its progress."""

    def __call__(self, task: Task, *, pretrained: str = "", examples: str = "") -> None:
        """As `train_and_report`."""
        ...


def _stage(prepare: Callable[[Run, Finish], None]) -> Callable[[Run, Finish], None]:
    """Make a function that prepares a stage's task a command of the same name and help, for an existing training."""
    name = prepare.__name__

    @train.command(name, help=prepare.__doc__)
    def command(
        out: OutOption,
        begin: FromOption = None,
        data: SetOption = None,
        only: OnlyOption = None,
        steps: StepsOption = None,
        minutes: MinutesOption = None,
        threads: ThreadsOption = None,
        as_json: JsonOption = False,
    ) -> None:
        run = _run(out, None, None, threads, begin, name)
        if data is not None:
            _prepare(run, data, only)

        def finish(task: Task, *, pretrained: str = "", examples: str = "") -> None:
            train_and_report(run, name, task, steps, minutes, as_json, pretrained=pretrained, examples=examples)

        prepare(run, finish)

    return prepare


@train.command()
def autoencoder(
    out: OutOption,
    data: SetOption = None,
    only: OnlyOption = None,
    config: ConfigOption = None,
    begin: FromOption = None,
    seed: SeedOption = None,
    steps: StepsOption = None,
    minutes: MinutesOption = None,
    threads: ThreadsOption = None,
    as_json: JsonOption = False,
) -> None:
    """Train the autoencoder: windows of all modalities to one latent vector and back.

    [bold]Examples[/bold]

      flexmotion train autoencoder --set set --config stream -o training

      flexmotion train autoencoder --set set --only commercial --config stream -o free

      flexmotion train autoencoder --from released.safetensors --set set -o further --steps 60000
    """
    run = _run(out, config, seed, threads, begin, "autoencoder")
    store = _prepare(run, data, only)
    from flexmotion.training.autoencoder_task import AutoencoderTask
    from flexmotion.training.processes import Processes

    muscles = run.muscles(data)
    task = AutoencoderTask(run.config, store, run.seed, Processes(), muscles, begun=run.begun("autoencoder"))
    train_and_report(run, "autoencoder", task, steps, minutes, as_json)


@train.command()
def text(
    out: OutOption,
    steps: Annotated[int, typer.Option("--steps", min=1, help="Steps of the optimiser.")] = 6000,
    threads: ThreadsOption = None,
    as_json: JsonOption = False,
) -> None:
    """Train the sentence encoder: a small network distilled from a large one, for use offline.

    [bold]Examples[/bold]

      flexmotion train text -o training
    """
    run = _run(out, None, None, threads)
    from flexmotion.training.conditions import clip_captions, clip_parts
    from flexmotion.training.text_student import corpus, distil, minilm

    teacher, vocabulary = minilm()
    clips = run.store().clips
    captions = {text for clip in clips for text in clip_captions(clip)}
    captions |= {text for clip in clips for text, _, _ in clip_parts(clip)}
    with progress_bar("trains text") as progress:
        sentences = corpus(vocabulary, sorted(captions), run.seed)
        figures = distil(
            teacher, vocabulary, sentences, run.stage("text"), steps=steps, seed=run.seed, progress=progress
        )
    if as_json:
        print_json({"stage": "text", "steps": steps, "validation": figures})
    else:
        print_result(f"{run.stage('text')}: {figures_text(figures)}")


@train.command()
def listener(
    bundle: Annotated[Path, typer.Argument(metavar="BUNDLE", help="Bundle of a trained model.")],
    out: Annotated[Path, typer.Option("--out", "-o", help="Folder of the copy with the new listener.")],
    more: Annotated[
        Path | None,
        typer.Option("--sayings", help="Your YAML file: kinds of motion, each with a list of sentences."),
    ] = None,
    as_json: JsonOption = False,
) -> None:
    r"""Fit a finished model's listener again: which sentence asks for which motion. Its motions do not change.

    [bold]Examples[/bold]

      flexmotion train listener bundle -o taught

      flexmotion train listener bundle --sayings ours.yaml -o taught    (walk: \[patrol the corridor, make your rounds])
    """
    needs_training()
    from flexmotion.bundles.bundle import Bundle
    from flexmotion.text.sayings import read_sayings
    from flexmotion.training.listener_training import refit_listener

    refitted = refit_listener(Bundle(bundle), out, () if more is None else read_sayings(more))
    if as_json:
        print_json({"bundle": str(out), "hash": refitted.hash})
    else:
        print_result(f"{out}: hash {refitted.hash}")


@_stage
def diffusion(run: Run, finish: Finish) -> None:
    """Train the latent diffusion on text, history and velocity; needs autoencoder and text.

    [bold]Examples[/bold]

      flexmotion train diffusion -o training --minutes 60

      flexmotion train diffusion --from released.safetensors --set set -o further --steps 120000
    """
    finish(_diffusion_task(run))


@_stage
def distill(run: Run, finish: Finish) -> None:
    """Distil the diffusion model to a few steps; needs diffusion. A personalised one needs no more than a thousand.

    [bold]Examples[/bold]

      flexmotion train distill -o training

      flexmotion train distill -o ada_training --steps 600
    """
    from flexmotion.training.checkpoints import load_weights
    from flexmotion.training.distillation_task import DistillationTask
    from flexmotion.training.personal import personal_teacher

    if run.personal_wordings():
        person, examples = personal_teacher(run)
        beside = "set" if run.has_features else "own samples"
        finish(DistillationTask(run.config, person, run.seed, examples), examples=f"person, {beside}")
        return
    teacher = _diffusion_task(run)
    load_weights(teacher.network, run.stage("diffusion"))
    finish(DistillationTask(run.config, teacher, run.seed))


@_stage
def control(run: Run, finish: Finish) -> None:
    """Train the control branch: places, path, torques, forces, muscles of single frames. Needs distill.

    [bold]Examples[/bold]

      flexmotion train control -o training --minutes 60

      flexmotion train control --from released.safetensors --set set -o further
    """
    from flexmotion.training.checkpoints import digest, load_weights
    from flexmotion.training.control_task import VERSION, ControlTask
    from flexmotion.training.export import load_networks

    if personal := run.personal_wordings():
        raise ConfigError(f"{run.folder}: is personalised to {personal[0]!r}; its branch is that of the model before")
    student = load_networks(run, distilled=True)[1]
    teacher = _diffusion_task(run)
    load_weights(teacher.network, run.stage("diffusion"))
    built_on = digest(dict(student.named_parameters())) + run.config.control.model_dump_json(exclude={"latent"})
    built_on += f"draws and loss {VERSION}"
    finish(ControlTask(run.config, teacher, student, run.seed), pretrained=built_on)


@_stage
def forces(run: Run, finish: Finish) -> None:
    """Train torques, forces, contacts and activations further; the motion does not change. Needs autoencoder.

    [bold]Examples[/bold]

      flexmotion train forces -o training --minutes 20
    """
    from flexmotion.training.autoencoder_task import AutoencoderTask
    from flexmotion.training.checkpoints import digest
    from flexmotion.training.processes import Processes

    trained = run.stage("autoencoder")
    task = AutoencoderTask(run.config, run.store(), run.seed, Processes(), run.muscles(), trained)
    finish(task, pretrained=digest(task.network.motion()))


@_stage
def evaluator(run: Run, finish: Finish) -> None:
    """Train the evaluator, with which `evaluate` compares motions and sentences; needs text.

    [bold]Examples[/bold]

      flexmotion train evaluator -o training
    """
    from flexmotion.training.evaluator_task import EvaluatorTask
    from flexmotion.training.processes import Processes

    finish(EvaluatorTask(run.config, run.store(), _encoder(run), run.seed, Processes()))


@train.command()
def curves(
    out: OutOption,
    picture: Annotated[Path, typer.Option("--picture", help="PNG to write.")] = Path("training.png"),
    as_json: JsonOption = False,
) -> None:
    """Draw the validations of all stages of a training.

    [bold]Examples[/bold]

      flexmotion train curves -o training --picture docs/results/training.png
    """
    from flexmotion.streamer.plots.training_curves import least, plot_training, read_curve

    found = {path.parent.name: read_curve(path) for path in sorted(out.glob("*/history.jsonl"))}
    found = {stage: curve for stage, curve in found.items() if curve}
    if not found:
        raise ConfigError(f"{out}: no stage of a training with a validation there")
    plot_training(found, picture, out.name)
    best = {stage: {"steps": max(curve), "best": least(curve)} | curve[least(curve)] for stage, curve in found.items()}
    if as_json:
        print_json(best)
        return
    for stage, figures in best.items():
        shown = {name: value for name, value in figures.items() if name not in ("steps", "best")}
        print_result(f"{stage}: {figures['steps']} steps, best at {figures['best']}: {figures_text(shown)}")


def _encoder(run: Run) -> SentenceEncoder:
    """The run's own sentence encoder."""
    from flexmotion.text.sentence_encoder import NETWORK, SentenceEncoder

    if not (run.stage("text") / NETWORK).is_file():
        raise ConfigError(f"{run.stage('text')}: not found; run 'flexmotion train text' first")
    return SentenceEncoder(run.stage("text"))


def _diffusion_task(run: Run) -> DiffusionTask:
    from flexmotion.training.autoencoder_task import load_autoencoder
    from flexmotion.training.diffusion_task import DiffusionTask
    from flexmotion.training.processes import Processes

    autoencoder, begun = load_autoencoder(run), run.begun("diffusion")
    return DiffusionTask(run.config, run.store(), autoencoder, _encoder(run), run.seed, Processes(), trained=begun)


def _prepare(run: Run, data: Path | None, only: str | None) -> FeatureStore:
    """Features of a set, and where the run has such a loss the fit of its muscles."""
    if only is not None and data is None:
        raise typer.BadParameter("--only: of a set; give --set")
    with progress_bar("computes features") as progress:
        store = run.store(data, progress, () if only is None else only.split(","))
    if data is not None:
        run.muscles(data)
    return store


def _run(
    out: Path,
    config: str | None,
    seed: int | None,
    threads: int | None,
    begin: Path | None = None,
    stage: str = "",
) -> Run:
    """The training of a folder; of a weights file `begin`, with the weights that a stage goes on from."""
    needs_training()
    from flexmotion.training.processes import use_threads
    from flexmotion.training.run import Run

    if threads is not None:
        use_threads(threads)
    if begin is None:
        return Run(out, config, seed)
    from flexmotion.training.release import begin_run

    # The forces are a part of the autoencoder in a weights file.
    return begin_run(begin, out, ["autoencoder" if stage == "forces" else stage], config, seed)
