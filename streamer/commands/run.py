"""`flexmotion run`: stream a motion to a robot through a driver."""

from __future__ import annotations

from typing import Annotated

import typer

from flexmotion.streamer.commands.options import (
    BundleOption,
    ClipOption,
    Clock,
    FeedbackOption,
    JsonOption,
    LogOption,
    MappingOption,
    PromptOption,
    RealtimeOption,
    ReportOption,
    ScriptOption,
    SecondsOption,
    SeedOption,
    SettingsOption,
    ViewOption,
    ViewPortOption,
)


def run(
    robot: Annotated[str, typer.Option("--robot", "-r", help="A shipped robot's name or a robot folder.")],
    driver: Annotated[str, typer.Option("--driver", "-d", help="Driver to use (see `flexmotion drivers`).")],
    port: Annotated[str | None, typer.Option("--port", "-p", help="Port of the servo bus.", show_default=False)] = None,
    clip: ClipOption = None,
    script: ScriptOption = None,
    prompt: PromptOption = None,
    bundle: BundleOption = None,
    mapping: MappingOption = None,
    seconds: SecondsOption = None,
    seed: SeedOption = 0,
    clock: Annotated[
        Clock, typer.Option(help="real: on the wall clock; lockstep: for drivers that simulate in this process.")
    ] = "real",
    option: Annotated[
        list[str] | None, typer.Option("--option", "-o", metavar="KEY=VALUE", help="Option of the driver (repeatable).")
    ] = None,
    once: Annotated[
        bool, typer.Option("--once", help="End when the motion is over; --seconds does so too. Else the robot stays.")
    ] = False,
    feedback: FeedbackOption = True,
    realtime: RealtimeOption = True,
    settings: SettingsOption = None,
    report: ReportOption = None,
    log: LogOption = None,
    view: ViewOption = False,
    view_port: ViewPortOption = 8080,
    as_json: JsonOption = False,
) -> None:
    """Stream a motion to a robot: stand up, follow, then stay standing until told to end.

    Ctrl-C or SIGTERM brings the robot to a balanced stop, parks it and ends; a second one ends at once, torque off.
    SIGUSR1 is a stop (the robot stands), SIGUSR2 an emergency stop (it freezes, then parks, the fault latched).

    [bold]Examples[/bold]

      flexmotion run --robot op3 --driver sim --prompt "walk forward"

      flexmotion run --robot op3 --driver sim --clip wave.bvh

      flexmotion run --robot op3 --driver sim --clip walk.bvh --once --report report
    """
    # From here on a signal is a request, also while the rest is loaded. Heavy imports wait until the command runs: help
    # and completion answer at once.
    from flexmotion.streamer.commands.signals import operator_signals

    with operator_signals() as signals:
        from flexmotion.configs.robot import load_robot
        from flexmotion.configs.stream import load_stream
        from flexmotion.streamer.commands.choice import choose_source
        from flexmotion.streamer.commands.driver_options import parse_options
        from flexmotion.streamer.commands.log_option import log_file
        from flexmotion.streamer.commands.streaming import RunRequest, present, stream

        stream_settings = load_stream(settings)
        stay = clock == "real" and not once and seconds is None
        chosen = load_robot(robot)
        source = choose_source(
            chosen,
            clip=clip,
            script=script,
            prompt=prompt,
            bundle=bundle,
            mapping=mapping,
            blend_frames=stream_settings.blend_frames,
            seed=seed,
            seconds=seconds,
            endless=stay,
        )
        options = parse_options(option or ())
        if port is not None:
            options["port"] = port
        outcome = stream(
            RunRequest(
                robot=chosen,
                driver=driver,
                source=source,
                settings=stream_settings,
                seed=seed,
                clock=clock,
                feedback=feedback,
                stay=stay,
                realtime=realtime,
                driver_options=options,
                log=log_file(log, report),
                view_port=view_port if view else None,
            ),
            signals,
        )
    present(outcome, report, as_json)
