"""`flexmotion check`: checks that end in exit code 0 or 1."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from streamer.commands.options import (
    ClipOption,
    JsonOption,
    MappingOption,
    PromptOption,
    RealtimeOption,
    ReportOption,
    RobotOption,
    ScriptOption,
    SeedOption,
    SettingsOption,
)
from streamer.commands.output import print_json, print_note, print_result, progress_bar

CHECK_FAILED, INTERRUPTED = 1, 130

check = typer.Typer(no_args_is_help=True)


@check.callback()
def _checks() -> None:
    """Checks of what a motion or this machine can do; exit code 1 past a limit."""


@check.command()
def torque(
    clip: ClipOption = None,
    script: ScriptOption = None,
    prompt: PromptOption = None,
    robot: RobotOption = "op3",
    mapping: MappingOption = None,
    settings: SettingsOption = None,
    report: ReportOption = None,
    as_json: JsonOption = False,
) -> None:
    """Check the torque that a motion asks of every servo, peak and thermal, against what the servo has.

    Plans the motion without running it. Exit code 1 where a servo cannot give what is asked, or would overheat.

    [bold]Examples[/bold]

      flexmotion check torque --clip walk.bvh

      flexmotion check torque --clip walk.bvh --robot ./my_robot --json
    """
    # Heavy imports wait until the command runs: help and completion answer at once.
    from configs.robot import load_robot
    from configs.stream import load_stream
    from streamer.commands.choice import choose_motion
    from streamer.offline import retarget_offline
    from streamer.plots import write_torque
    from streamer.sources import ClipSource
    from streamer.torque_check import check_trajectory, render_check

    chosen = load_robot(robot)
    stream_settings = load_stream(settings)
    motion = choose_motion(
        clip=clip, script=script, prompt=prompt, mapping=mapping, blend_frames=stream_settings.blend_frames
    )
    with progress_bar(f"{chosen.name} retargets {motion.source}") as progress:
        trajectory = retarget_offline(chosen, ClipSource(motion), stream_settings, progress)
    result = check_trajectory(trajectory, chosen, motion.source)
    if as_json:
        print_json(result.json_text())
    else:
        print_result(render_check(result))
    if report is not None:
        report.mkdir(parents=True, exist_ok=True)
        (report / "torque.json").write_text(result.json_text() + "\n", encoding="utf-8")
        print_note(f"drawn: {write_torque(report / 'torque.png', trajectory.torque, trajectory.qd, chosen)}")
    if not result.ok:
        raise typer.Exit(CHECK_FAILED)


@check.command()
def latency(
    robot: RobotOption = "op3",
    clip: Annotated[
        list[Path] | None,
        typer.Option("--clip", "-c", help="Clips to switch between (two or more); else parts of the shipped one."),
    ] = None,
    seconds: Annotated[float, typer.Option(help="How long to measure [s].", min=5.0)] = 60.0,
    switches: Annotated[
        int | None, typer.Option(help="Measure until so many switches were made, instead.", min=1, show_default=False)
    ] = None,
    load: Annotated[int, typer.Option(help="Busy processes beside it.", min=0)] = 0,
    realtime: RealtimeOption = True,
    seed: SeedOption = 0,
    mapping: MappingOption = None,
    settings: SettingsOption = None,
    report: ReportOption = None,
    as_json: JsonOption = False,
) -> None:
    """Measure on this machine how late the loop wakes and how fast a new target becomes a command.

    Runs the live system with the simulated robot on the real clock and switches clips at random moments. Exit code 1
    where a budget of the stream settings is passed, or where the system grants no realtime scheduling.

    [bold]Examples[/bold]

      flexmotion check latency

      flexmotion check latency --seconds 20 --load 2 --report report
    """
    from configs.robot import load_robot
    from configs.stream import load_stream
    from drivers.registry import create
    from streamer.commands.choice import library_of
    from streamer.commands.signals import operator_signals
    from streamer.latency import measure
    from streamer.latency_text import render_latency
    from streamer.plots import write_latency

    chosen = load_robot(robot)
    stream_settings = load_stream(settings)
    clips = library_of(clip, mapping) if clip else None
    with operator_signals() as signals, progress_bar(f"{chosen.name} answers") as progress:
        result = measure(
            chosen,
            create("sim", chosen, seed=seed),
            stream_settings,
            seconds=seconds,
            switches=switches,
            clips=clips,
            load=load,
            realtime=realtime,
            seed=seed,
            progress=progress,
            request=signals.next,
            wake=signals.wake,
        )
    text = json.dumps(result.content(), indent=2)
    if as_json:
        print_json(text)
    else:
        print_result(render_latency(result))
    if report is not None:
        report.mkdir(parents=True, exist_ok=True)
        (report / "latency.json").write_text(text + "\n", encoding="utf-8")
        print_note(f"drawn: {write_latency(report / 'latency.png', result)}")
    if signals.interrupted:
        raise typer.Exit(INTERRUPTED)
    if not result.ok:
        raise typer.Exit(CHECK_FAILED)
