"""`flexmotion log`: show, plot or replay the log of a run."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from flexmotion.streamer.commands.exit_codes import CHECK_FAILED
from flexmotion.streamer.commands.options import JsonOption, writable_folder
from flexmotion.streamer.commands.output import print_json, print_note, print_result, progress_bar

log = typer.Typer(help="Show, plot and replay logs of runs.", no_args_is_help=True)

FileArgument = Annotated[Path, typer.Argument(metavar="FILE", help="Log (.mcap) of `dry-run` or `run`.")]


@log.command()
def show(file: FileArgument, as_json: JsonOption = False) -> None:
    """Print what is in a log: length, states, plans, targets, events, timing and topics.

    [bold]Examples[/bold]

      flexmotion log show run.mcap
    """
    # Heavy imports wait until the command runs: help and completion answer at once.
    from flexmotion.streamer.log.reader import read_log
    from flexmotion.streamer.log.summary import describe, render_log

    content = describe(read_log(file))
    if as_json:
        print_json(content)
    else:
        print_result(render_log(content))


@log.command()
def plot(
    file: FileArgument,
    out: Annotated[Path, typer.Option("--out", "-o", callback=writable_folder, help="Folder for the pictures.")],
) -> None:
    """Draw the pictures of a run from its log.

    [bold]Examples[/bold]

      flexmotion log plot run.mcap -o pictures
    """
    from flexmotion.configs.errors import ConfigError
    from flexmotion.streamer.log.judged import Subject
    from flexmotion.streamer.log.reader import read_log
    from flexmotion.streamer.plots.pictures import write_plots

    found = read_log(file)
    if not len(found.rows):
        raise ConfigError(f"{file}: has no tick to draw")
    subject = Subject.of(found)
    record = found.record()
    for path in write_plots(out, record, subject.robot, subject.figures, subject.motion, subject.profile(record)):
        print_note(f"drawn: {path}")


@log.command()
def replay(file: FileArgument, as_json: JsonOption = False) -> None:
    """Run a log's source again, in lockstep on the simulated robot, and compare how the robot moved.

    Uses the log's settings, seed, driver options, targets and requests. Exit code 1 where a figure differs by more than
    its tolerance; a log of a lockstep run must give equal figures.

    [bold]Examples[/bold]

      flexmotion log replay run.mcap
    """
    from flexmotion.streamer.log.judged import Subject
    from flexmotion.streamer.log.reader import read_log
    from flexmotion.streamer.log.replay import replay as run_again
    from flexmotion.streamer.log.summary import describe_replay, render_replay

    found = read_log(file)
    subject = Subject.of(found)
    for name in found.changed_files(subject.robot):
        print_note(f"note: {name} has changed since the log was written")
    if found.header.driver != "sim":
        print_note(f"note: the log is of driver {found.header.driver!r}; the simulation is run with its own options")
    with progress_bar(f"replays {file.name}") as progress:
        result = run_again(found, subject, progress)
    if as_json:
        print_json(describe_replay(found, result))
    else:
        print_result(render_replay(result))
    if not result.agrees:
        raise typer.Exit(CHECK_FAILED)
