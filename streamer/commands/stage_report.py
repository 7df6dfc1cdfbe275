"""`train_and_report`: trains one stage with a progress bar, and prints the result."""

from __future__ import annotations

from typing import TYPE_CHECKING

import typer

from flexmotion.streamer.commands.exit_codes import INTERRUPTED
from flexmotion.streamer.commands.first_signal import first_signal
from flexmotion.streamer.commands.output import print_json, print_note, print_result, progress_bar

if TYPE_CHECKING:
    from flexmotion.training.run import Run
    from flexmotion.training.stage import Task


def train_and_report(
    run: Run,
    name: str,
    task: Task,
    steps: int | None,
    minutes: float | None,
    as_json: bool,
    *,
    pretrained: str = "",
    examples: str = "",
) -> None:
    """Train a stage of a run with a progress bar on stderr, and print the result, in the first process alone.

    The first signal saves the state and ends the command; a second one ends it at once. The processes leave their group
    after the training: this is the end of a command.

    Args:
        run: of the stage.
        name: of the stage.
        task: of the stage.
        steps: instead of the configuration's.
        minutes: time after which training stops.
        as_json: print JSON.
        pretrained: digest of the trained weights that the task starts with; empty for a new network.
        examples: what it is trained on, where that is not the set: a stage does not go on with others.

    Raises:
        typer.Exit: a signal came.
    """
    from flexmotion.training.checkpoints import BEST, begun_from, read_checkpoint
    from flexmotion.training.processes import Processes
    from flexmotion.training.stage import Progress, train_stage

    folder, stage = run.stage(name), getattr(run.config.stages, name)
    if steps is not None:
        stage = stage.model_copy(update={"steps": steps, "validate_every": min(stage.validate_every, steps)})
    shown: dict[str, float] = {}
    processes = Processes()
    if processes.first and (begun := begun_from(folder)) is not None:
        at = read_checkpoint(folder / BEST)["step"]
        print_note(
            f"begins at step {at} with weights of {begun}: the state of the optimiser is not in them, its averages"
            f" begin anew and the learning rate rises again over {stage.warm_up} steps"
        )
        if at >= stage.steps:
            print_note(f"nothing to train: --steps is {stage.steps}; give more than {at}")

    with progress_bar(f"trains {name}") as bar, first_signal() as signalled:

        def follow(progress: Progress) -> None:
            if not processes.first:
                return
            bar(progress.step / progress.steps)
            if progress.figures and progress.figures != shown:
                shown.clear()
                shown.update(progress.figures)
                print_note(f"step {progress.step}: {figures_text(progress.figures)}")

        done = train_stage(
            task,
            stage,
            folder,
            fingerprint=run.fingerprint() + pretrained + examples,
            seconds=None if minutes is None else 60 * minutes,
            progress=follow,
            processes=processes,
            pretrained=bool(pretrained),
            stop=signalled,
        )
        stopped = processes.any(signalled()) and done.step < done.steps
    processes.close()
    if processes.first and stopped:
        print_note(f"{folder}: interrupted and saved; resumes from step {done.step} of {done.steps}")
    if stopped:
        raise typer.Exit(INTERRUPTED)
    if not processes.first:
        return
    if as_json:
        print_json({"stage": name, "step": done.step, "steps": done.steps, "validation": done.figures})
    else:
        steps_done = f"step {done.step} of {done.steps}"
        print_result(f"{folder}: {', '.join(filter(None, (steps_done, figures_text(done.figures))))}")


def figures_text(figures: dict[str, float]) -> str:
    """Figures of a validation in one line."""
    return ", ".join(f"{name} {value:.4g}" for name, value in figures.items())
