"""`flexmotion run`: stream a motion to a robot through a driver."""

from __future__ import annotations

from typing import Annotated

import typer

from streamer.commands.options import (
    ClipOption,
    Clock,
    FeedbackOption,
    JsonOption,
    LogOption,
    MappingOption,
    PromptOption,
    ReportOption,
    ScriptOption,
    SecondsOption,
    SeedOption,
    SettingsOption,
)


def run(
    robot: Annotated[str, typer.Option("--robot", "-r", help="A shipped robot's name or a robot folder.")],
    driver: Annotated[str, typer.Option("--driver", "-d", help="Driver to use (see `flexmotion drivers`).")],
    port: Annotated[str | None, typer.Option("--port", "-p", help="Port of the servo bus.", show_default=False)] = None,
    clip: ClipOption = None,
    script: ScriptOption = None,
    prompt: PromptOption = None,
    mapping: MappingOption = None,
    seconds: SecondsOption = None,
    seed: SeedOption = 0,
    clock: Annotated[
        Clock, typer.Option(help="real: on the wall clock; lockstep: for drivers that simulate in this process.")
    ] = "real",
    option: Annotated[
        list[str] | None, typer.Option("--option", "-o", metavar="KEY=VALUE", help="Option of the driver (repeatable).")
    ] = None,
    feedback: FeedbackOption = True,
    settings: SettingsOption = None,
    report: ReportOption = None,
    log: LogOption = None,
    as_json: JsonOption = False,
) -> None:
    """Stream a motion to a robot: stand up, follow, stop, park.

    Ctrl-C brings the robot to a balanced stop and parks it; a second one ends at once.

    [bold]Examples[/bold]

      flexmotion run --robot op3 --driver sim --clip wave.bvh
    """
    # Heavy imports wait until the command runs: help and completion answer at once.
    from configs.stream import load_stream
    from streamer.commands.choice import choose_motion
    from streamer.commands.driver_options import parse_options
    from streamer.commands.recording import log_file
    from streamer.commands.streaming import RunRequest, present, stream

    stream_settings = load_stream(settings)
    motion = choose_motion(
        clip=clip, script=script, prompt=prompt, mapping=mapping, blend_frames=stream_settings.blend_frames
    )
    options = parse_options(option or ())
    if port is not None:
        options["port"] = port
    outcome = stream(
        RunRequest(
            robot=robot,
            driver=driver,
            motion=motion,
            settings=stream_settings,
            seconds=seconds,
            seed=seed,
            clock=clock,
            feedback=feedback,
            driver_options=options,
            log=log_file(log, report),
        )
    )
    present(outcome, report, as_json)
