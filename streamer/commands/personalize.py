"""`flexmotion personalize`: a trained model learns how one person moves."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from flexmotion.streamer.commands.options import JsonOption
from flexmotion.streamer.commands.output import progress_bar
from flexmotion.streamer.commands.train import MinutesOption, ThreadsOption, needs_training, train_and_report


def personalize(
    training: Annotated[Path, typer.Argument(metavar="TRAINING", help="Folder that `train` wrote.")],
    data: Annotated[Path, typer.Option("--set", help="Set of the person's clips, that `data build` wrote.")],
    manner: Annotated[str, typer.Option(help='How prompts will ask for it, such as "like Ada".')],
    out: Annotated[Path, typer.Option("--out", "-o", help="Folder of the new training.")],
    steps: Annotated[int, typer.Option("--steps", min=1, help="Of the optimiser.")] = 1000,
    minutes: MinutesOption = None,
    threads: ThreadsOption = None,
    as_json: JsonOption = False,
) -> None:
    """Fine-tune a model on a few clips of one person or style; what it knew is trained on along with them.

    The new folder is a training as others are: `train distill` and `export` make a bundle of it.

    [bold]Examples[/bold]

      flexmotion personalize training --set ada --manner "like Ada" -o ada_training
    """
    needs_training()
    from flexmotion.training.personal import personal_run, personal_task
    from flexmotion.training.processes import use_threads
    from flexmotion.training.run import Run

    if threads is not None:
        use_threads(threads)
    trained = Run(training)
    run = personal_run(trained, out, manner)
    with progress_bar("computes features") as progress:
        task = personal_task(run, trained, data, manner, progress)
    train_and_report(run, "diffusion", task, steps, minutes, as_json)
