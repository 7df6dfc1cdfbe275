"""`flexmotion check`: checks that end in exit code 0 or 1."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from flexmotion.streamer.commands.exit_codes import CHECK_FAILED, INTERRUPTED
from flexmotion.streamer.commands.option_groups import CheckOptions, MotionOptions, grouped
from flexmotion.streamer.commands.options import BundleOption, MappingOption, RealtimeOption, RobotOption, SeedOption
from flexmotion.streamer.commands.output import print_json, print_note, print_result, progress_bar

check = typer.Typer(no_args_is_help=True)


@check.callback()
def _checks() -> None:
    """Checks of a motion, a bus or this machine; exit code 1 where a limit is exceeded."""


@check.command()
@grouped
def torque(
    *,
    robot: RobotOption = "op3",
    motion: MotionOptions,
    seconds: Annotated[
        float | None,
        typer.Option("--seconds", "-s", min=0.1, max=1e6, help="Check at most this many seconds.", show_default=False),
    ] = None,
    supply: Annotated[
        float | None,
        typer.Option("--supply", min=1.0, max=60.0, help="Voltage at the servos \\[V].", show_default="nominal"),
    ] = None,
    options: CheckOptions,
) -> None:
    """Check the torque that a motion needs from every servo, at every tick and over time, against the servo's envelope.

    Plans the motion as a run would, without running it. Exit code 1 where a servo lacks so much torque that its joint
    falls behind by more than a swing allows, or would grow too hot within ten minutes of this motion, or where words
    were refused.

    [bold]Examples[/bold]

      flexmotion check torque --clip walk.bvh

      flexmotion check torque --prompt "walk forward" --seconds 5

      flexmotion check torque --clip walk.bvh --supply 10.5

      flexmotion check torque --clip walk.bvh --robot ./my_robot --json
    """
    # Heavy imports wait until the command runs: help and completion answer at once.
    from flexmotion.configs.robot import load_robot
    from flexmotion.configs.stream import load_stream
    from flexmotion.streamer.checks.torque_check import check_trajectory
    from flexmotion.streamer.checks.torque_text import render_check
    from flexmotion.streamer.motion.model_source import ModelSource
    from flexmotion.streamer.planning.offline import retarget_offline

    chosen = load_robot(robot)
    most = min(chosen.servos, key=lambda servo: servo.max_voltage)
    if supply is not None and supply > most.max_voltage:
        raise typer.BadParameter(
            f"--supply: {supply:g} V, expected at most {most.max_voltage:g}, for servo {most.name}"
        )
    settings = load_stream(options.settings)
    source = motion.source(chosen, settings, seconds)
    for remark in source.remarks:
        print_note(f"note: {remark}")
    with progress_bar(f"{chosen.name} retargets {source.name}") as progress:
        trajectory = retarget_offline(chosen, source, settings, progress)
    heard = source.heard_items if isinstance(source, ModelSource) else ()
    refused = tuple(str(one.asked) for one in heard if one.state == "refused")
    result = check_trajectory(trajectory, chosen, source.name, supply, refused)
    if options.as_json:
        print_json(result.json_text())
    else:
        print_result(render_check(result))
    if options.report is not None:
        from flexmotion.streamer.plots.torque import write_torque

        options.report.mkdir(parents=True, exist_ok=True)
        (options.report / "torque.json").write_text(result.json_text() + "\n", encoding="utf-8")
        picture = write_torque(options.report / "torque.png", trajectory.torque, trajectory.qd, chosen)
        print_note(f"drawn: {picture}")
    if not result.ok:
        raise typer.Exit(CHECK_FAILED)


@check.command()
@grouped
def latency(
    *,
    robot: RobotOption = "op3",
    clip: Annotated[
        list[Path] | None,
        typer.Option("--clip", "-c", help="Switch between these clips (two or more) instead of asking a model."),
    ] = None,
    bundle: BundleOption = None,
    seconds: Annotated[float, typer.Option(help="How long to measure \\[s].", min=5.0, max=1e6)] = 60.0,
    switches: Annotated[
        int | None, typer.Option(help="Measure until this many targets were sent, instead.", min=1, show_default=False)
    ] = None,
    load: Annotated[int, typer.Option(help="Busy processes beside the run.", min=0)] = 0,
    realtime: RealtimeOption = True,
    seed: SeedOption = 0,
    mapping: MappingOption = None,
    options: CheckOptions,
) -> None:
    """Measure on this machine how late the loop wakes and how fast a new target becomes a command.

    Runs the live system with the simulated robot on the real clock and sends the model another target at random moments
    (another clip without a model). Exit code 1 where a budget of the stream settings is exceeded, or where the system
    grants no realtime scheduling.

    [bold]Examples[/bold]

      flexmotion check latency

      flexmotion check latency --seconds 20 --load 2 --report report
    """
    from flexmotion.configs.robot import load_robot
    from flexmotion.configs.stream import load_stream
    from flexmotion.drivers.registry import create
    from flexmotion.streamer.checks.latency import measure
    from flexmotion.streamer.checks.latency_text import render_latency
    from flexmotion.streamer.commands.choice import choose_switched
    from flexmotion.streamer.commands.signals import operator_signals

    chosen = load_robot(robot)
    stream_settings = load_stream(options.settings)
    source, intents = choose_switched(chosen, clip or (), bundle, mapping, seed)
    length = f"{seconds:g} s" if switches is None else f"{switches} targets"
    print_note(f"measures for {length}; the robot stands up before and parks after it, which takes some seconds more")
    with operator_signals() as signals, progress_bar(f"{chosen.name} answers") as progress:
        result = measure(
            chosen,
            create("sim", chosen, seed=seed),
            stream_settings,
            source,
            intents,
            seconds=seconds,
            switches=switches,
            load=load,
            realtime=realtime,
            seed=seed,
            progress=progress,
            request=signals.next,
            wake=signals.wake,
        )
    text = json.dumps(result.content(), indent=2)
    if options.as_json:
        print_json(text)
    else:
        print_result(render_latency(result))
    if options.report is not None:
        from flexmotion.streamer.plots.latency import write_latency

        options.report.mkdir(parents=True, exist_ok=True)
        (options.report / "latency.json").write_text(text + "\n", encoding="utf-8")
        print_note(f"drawn: {write_latency(options.report / 'latency.png', result)}")
    if signals.interrupted:
        raise typer.Exit(INTERRUPTED)
    if not result.ok:
        raise typer.Exit(CHECK_FAILED)
