"""`flexmotion dry-run`: the whole live system on the simulated robot."""

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
    ReplanNoiseOption,
    ReportOption,
    RobotOption,
    ScriptOption,
    SecondsOption,
    SeedOption,
    SettingsOption,
    ViewOption,
    ViewPortOption,
)


def dry_run(
    robot: RobotOption = "op3",
    clip: ClipOption = None,
    script: ScriptOption = None,
    prompt: PromptOption = None,
    bundle: BundleOption = None,
    mapping: MappingOption = None,
    seconds: SecondsOption = None,
    seed: SeedOption = 0,
    clock: Annotated[
        Clock | None,
        typer.Option(
            help="lockstep: step by step, as fast as it computes; real: on the wall clock.",
            show_default="lockstep; with --view real",
        ),
    ] = None,
    perturb: Annotated[
        list[str] | None,
        typer.Option(
            "--perturb",
            metavar="KEY=VALUE",
            help="How the simulated robot differs from its model (repeatable); see the simulation's options.",
        ),
    ] = None,
    perturbed: Annotated[
        bool, typer.Option("--perturbed", help="The standard mismatch: mass, delay, gains, friction, slope, pushes.")
    ] = False,
    replan_noise: ReplanNoiseOption = 0.0,
    feedback: FeedbackOption = True,
    realtime: RealtimeOption = True,
    settings: SettingsOption = None,
    report: ReportOption = None,
    log: LogOption = None,
    view: ViewOption = False,
    view_port: ViewPortOption = 8080,
    as_json: JsonOption = False,
) -> None:
    """Stream a motion to the simulated robot and report how well it followed.

    With no option what comes with the project: a script of words for its model, or a short clip where it has none. A
    prompt, and the last item of a script that does not stop, is followed for 10 s where --seconds says nothing else.
    Exit code 1 when it fell or a limit was passed.

    [bold]Examples[/bold]

      flexmotion dry-run

      flexmotion dry-run --prompt "wave with the right hand" --seconds 5

      flexmotion dry-run --clip walk.bvh --report report

      flexmotion dry-run --clip walk.bvh --view

      flexmotion dry-run --clip walk.bvh --perturbed --perturb total_mass=3.5 --seed 4 --json
    """
    # From here on a signal is a request, also while the rest is loaded. Heavy imports wait until the command runs: help
    # and completion answer at once.
    from flexmotion.streamer.commands.signals import operator_signals

    with operator_signals() as signals:
        from flexmotion.configs.robot import load_robot
        from flexmotion.configs.stream import load_stream
        from flexmotion.streamer.commands.choice import choose_source
        from flexmotion.streamer.commands.driver_options import simulation_options
        from flexmotion.streamer.commands.log_option import log_file
        from flexmotion.streamer.commands.streaming import RunRequest, present, stream

        stream_settings = load_stream(settings)
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
        )
        outcome = stream(
            RunRequest(
                robot=chosen,
                driver="sim",
                source=source,
                settings=stream_settings,
                seed=seed,
                clock=clock or ("real" if view else "lockstep"),
                feedback=feedback,
                realtime=realtime,
                replan_noise_m=replan_noise,
                driver_options=simulation_options(perturbed, perturb or ()),
                log=log_file(log, report),
                view_port=view_port if view else None,
            ),
            signals,
        )
    present(outcome, report, as_json)
