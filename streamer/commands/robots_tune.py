"""`flexmotion robots tune`: numbers of a robot file, found by measurement on the simulated robot."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from flexmotion.streamer.commands.exit_codes import INTERRUPTED
from flexmotion.streamer.commands.options import JsonOption, writable_folder
from flexmotion.streamer.commands.output import print_json, print_note, print_result, progress_bar


def _print_numbers(wanted: bool) -> None:
    """Print the numbers that may be tuned, with their bounds and reasons, and leave."""
    if not wanted:
        return
    from flexmotion.configs.tunable import tunable_numbers

    known = tunable_numbers()
    for name, number in known.numbers.items():
        low, high = number.bounds
        times = "" if number.scale == "one" else f" times {number.scale}"
        print_result(f"{name} [{number.unit}]: {low:g} to {high:g}{times}; {number.reason}")
    for name, reason in known.kept.items():
        print_result(f"not {name}: {reason}")
    raise typer.Exit


def tune(
    robot: Annotated[str, typer.Argument(metavar="ROBOT", help="A shipped robot's name, or a robot folder.")],
    out: Annotated[
        Path,
        typer.Option(
            "--out", "-o", callback=writable_folder, help="Folder of the campaign: a new one, or one to go on in."
        ),
    ],
    numbers: Annotated[
        str, typer.Option("--numbers", metavar="NAME,NAME", help="Numbers to tune, with commas; see --list-numbers.")
    ],
    clips: Annotated[
        str, typer.Option("--clips", metavar="NAME|FILE", help="List that it is tuned on: tuning, or a YAML file.")
    ] = "tuning",
    report: Annotated[
        str,
        typer.Option(
            "--report", metavar="NAME|FILE", help="List that the result is reported on; it shares no clip with --clips."
        ),
    ] = "reporting",
    generations: Annotated[
        int, typer.Option("--generations", "-g", min=1, help="To search in all; more of them later go on.")
    ] = 10,
    population: Annotated[
        int | None,
        typer.Option(
            min=3, max=200, help="Candidates of a generation; else by the count of numbers.", show_default=False
        ),
    ] = None,
    seed: Annotated[int, typer.Option("--seed", min=0, help="Seed of the search and of all runs.")] = 0,
    jobs: Annotated[int, typer.Option("--jobs", "-j", min=1, max=256, help="Runs at a time, a process each.")] = 2,
    _list: Annotated[
        bool,
        typer.Option(
            "--list-numbers", callback=_print_numbers, is_eager=True, help="Print what may be tuned, and why, and exit."
        ),
    ] = False,
    as_json: JsonOption = False,
) -> None:
    r"""Find numbers of a robot file by measurement (CMA-ES): the robot follows a list of motions in lockstep.

    Upright comes first, then the way, the heading, the directions of arms and trunk, and the servos' heat. The folder
    gets the robot with the numbers found (robot/), and the figures before and after, on the list that was tuned on and
    on another one (tuning.json, tuning.md). The state is stored after every generation: the same command goes on where
    it was stopped. Ctrl-C writes what was found so far. Needs the extra 'tune'.

    A list is YAML by kind of motion, as walking: \[walk.bvh, {text: walk forward, seconds: 5}]; every second entry of
    a kind runs with the standard perturbations.

    [bold]Examples[/bold]

      flexmotion robots tune --list-numbers

      flexmotion robots tune op3 -o tuned --numbers gait.clearance,gait.double_support_min_s --generations 8

      flexmotion robots tune ./my_robot -o tuned --numbers gait.walk_hip_height --clips ours.yaml --report others.yaml

      flexmotion dry-run --robot tuned/robot --clip walk.bvh
    """
    # Heavy imports wait until the command runs: help and completion answer at once.
    from flexmotion.configs.robot import load_robot
    from flexmotion.configs.tunable import choose_numbers
    from flexmotion.streamer.log.lock import locked_folder
    from flexmotion.streamer.tuning.campaign import Plan, begin, search
    from flexmotion.streamer.tuning.campaign import report as report_on
    from flexmotion.streamer.tuning.clip_list import ClipList
    from flexmotion.streamer.tuning.measurer import ProcessMeasurer
    from flexmotion.streamer.tuning.result_files import write_result
    from flexmotion.streamer.tuning.result_text import markdown, verdict
    from flexmotion.streamer.tuning.workers import Workers

    chosen = load_robot(robot)
    named = [name.strip() for name in numbers.split(",") if name.strip()]
    plan = Plan(chosen, choose_numbers(named, chosen), ClipList(clips), ClipList(report), generations, seed, population)
    state, interrupted, done = None, False, 0
    with locked_folder(out, "--out"), progress_bar(f"{chosen.name} is tuned") as progress, Workers(jobs) as workers:

        def count() -> None:
            nonlocal done
            done += 1
            progress(min(done / plan.runs, 1.0))

        measurer = ProcessMeasurer(workers, count)
        try:
            state = begin(plan, out, measurer)
            done = plan.done(state)
            for found in search(plan, out, state, measurer, print_note):
                state = found
            state = report_on(plan, out, state, measurer)
        except KeyboardInterrupt:
            interrupted = True
            if state is None:
                raise
        result = write_result(plan, state, out)
    if as_json:
        print_json(result.model_dump_json(by_alias=True, indent=2))
    else:
        print_result(markdown(result))
    print_note(f"{out}: {verdict(result)}")
    if interrupted:
        raise typer.Exit(INTERRUPTED)
