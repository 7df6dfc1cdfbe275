"""`flexmotion dry-run`: the whole live system on the simulated robot."""

from __future__ import annotations

from typing import Annotated

import typer

from flexmotion.streamer.commands.option_groups import FollowedOptions, RunOptions, grouped
from flexmotion.streamer.commands.options import Clock, ReplanNoiseOption, RobotOption

PICKED_UP_S = 3.0
"""A run that takes targets goes on after a fall or a stop: the simulated robot is set up this long after it [s]."""


@grouped
def dry_run(
    *,
    robot: RobotOption = "op3",
    motion: FollowedOptions,
    clock: Annotated[
        Clock | None,
        typer.Option(
            help="lockstep: step by step, as fast as it computes; real: on the wall clock.",
            show_default="lockstep; with --view, --web, --stdin or --mirror real",
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
    run: RunOptions,
) -> None:
    """Stream a motion to the simulated robot and report how well it followed.

    With no option the robot follows what comes with the project: a script of words for its model, or a short clip where
    it has none. A prompt, and the last item of a script that does not stop, is followed for 10 s, or for --seconds.
    A prompt that says how much ("turn 90 degrees, then wave twice") ends when the robot has done it. Exit code 1 where
    the robot fell or a limit was passed, where a prompt was refused or not done whole (--allow-refused),
    and where the robot did less of the motion than --min-likeness. With --web
    the robot stands and follows what other programs send, until it is interrupted; 3 s after its torque has gone off it
    is set up again where it began, unless it has fallen and can get up. The command arms the simulated robot
    (--no-arm: it waits, as a real one does with `run --web`). With --mirror it follows a person whose frames come over
    UDP, and stands while nobody is seen.

    [bold]Examples[/bold]

      flexmotion dry-run

      flexmotion dry-run --prompt "wave with the right hand" --seconds 5

      flexmotion dry-run --prompt "two steps back, then turn 90 degrees to the left and wave twice"

      flexmotion dry-run --clip walk.bvh --report report

      flexmotion dry-run --clip walk.bvh --view

      flexmotion dry-run --web

      flexmotion dry-run --mirror --view

      flexmotion dry-run --clip walk.bvh --perturbed --perturb total_mass=3.5 --seed 4 --json
    """
    # From here on a signal is a request; while the rest is loaded, one for the end ends at once. Heavy imports wait
    # until the command runs: help and completion answer at once.
    from flexmotion.streamer.commands.signals import operator_signals

    with run.outputs():
        with operator_signals(loading=True) as signals:
            from flexmotion.configs.stream import load_stream
            from flexmotion.streamer.api import open_driver, open_robot
            from flexmotion.streamer.commands.driver_options import simulation_options
            from flexmotion.streamer.commands.streaming import present, stream
            from flexmotion.streamer.motion.replan_noise import NoisySource

            settings = load_stream(run.settings)
            run.check_ports(settings.gateway)
            chosen = open_robot(robot)
            stay = (run.listens or motion.mirrors) and run.seconds is None
            source = motion.followed(chosen, settings, run.seconds, endless=stay, listens=run.listens)
            options = simulation_options(perturbed, perturb or ())
            if stay and run.listens:
                options.setdefault("picked_up_s", PICKED_UP_S)
            if replan_noise and motion.mirrors:
                raise typer.BadParameter("--replan-noise and --mirror exclude each other")
            signals.loading = False
            session = run.session(
                open_driver("sim", chosen, **options, seed=motion.seed),
                NoisySource(source, replan_noise, motion.seed) if replan_noise else source,
                settings,
                clock=clock or ("real" if run.view or run.listens or motion.mirrors else "lockstep"),
                seed=motion.seed,
                seconds=run.streamed_s(source, stay=stay),
                stay=stay,
                mirror=motion.mirror_from(run.token_file),
            )
            outcome = stream(session, signals)
        present(outcome, run.report, run.as_json, signals, video=run.video)
