"""`flexmotion personalize`: fine-tunes a trained model on one person's clips."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from flexmotion.streamer.commands.options import JsonOption
from flexmotion.streamer.commands.output import progress_bar
from flexmotion.streamer.commands.stage_report import train_and_report
from flexmotion.streamer.commands.train import MinutesOption, ThreadsOption, needs_training


def personalize(
    training: Annotated[
        Path,
        typer.Argument(metavar="TRAINING|WEIGHTS", help="Folder that `train` wrote, or file of `export --weights`."),
    ],
    data: Annotated[Path, typer.Option("--set", help="Training set of the person's clips, of `data build`.")],
    manner: Annotated[str, typer.Option(help='Words that prompts ask for it by, such as "like Ada".')],
    out: Annotated[Path, typer.Option("--out", "-o", help="Folder of the new training.")],
    prior: Annotated[
        Path | None,
        typer.Option(
            help="With a weights file: a set of other people's clips, for kinds of motion that the person lacks.",
            show_default=False,
        ),
    ] = None,
    steps: Annotated[int, typer.Option("--steps", min=1, help="Steps of the optimiser.")] = 1000,
    minutes: MinutesOption = None,
    threads: ThreadsOption = None,
    as_json: JsonOption = False,
) -> None:
    """Fine-tune a model on a few clips of one person or style, beside the clips of its own training set.

    The new folder is a training: `train distill` and `export` make a bundle of it, in which requests in the manner have
    a network of their own and all others stay as they were. A weights file has no clips: kinds of motion that the
    person does not show are then learnt in the clips of --prior, or in motion that the model samples before.

    [bold]Examples[/bold]

      flexmotion personalize training --set ada --manner "like Ada" -o ada_training

      flexmotion personalize released.safetensors --set ada --manner "like Ada" -o ada_training
    """
    needs_training()
    from flexmotion.training.personal import personal_run, personal_task, training_of
    from flexmotion.training.processes import use_threads

    if threads is not None:
        use_threads(threads)
    if prior is not None and not training.is_file():
        raise typer.BadParameter("--prior: the clips of a training are those that it began with; it is for WEIGHTS")
    trained = training_of(training, out)
    if prior is not None:
        with progress_bar("computes features") as progress:
            trained.store(prior, progress)
    run = personal_run(trained, out, manner)
    with progress_bar("computes features") as progress:
        task = personal_task(run, trained, data, manner, progress)
    train_and_report(run, "diffusion", task, steps, minutes, as_json)
