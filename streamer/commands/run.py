"""`flexmotion run`: stream a motion to a robot through a driver."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer

from flexmotion.streamer.commands.bus_readout import PORTS_HELP
from flexmotion.streamer.commands.option_groups import FollowedOptions, RunOptions, grouped
from flexmotion.streamer.commands.options import Clock

if TYPE_CHECKING:
    from flexmotion.drivers.interface import Driver


@grouped
def run(
    *,
    robot: Annotated[str, typer.Option("--robot", "-r", help="A shipped robot's name or a robot folder.")],
    driver: Annotated[str, typer.Option("--driver", "-d", help="Driver to use (see `flexmotion drivers`).")],
    port: Annotated[
        str | None, typer.Option("--port", "-p", metavar="PORT", help=PORTS_HELP, show_default=False)
    ] = None,
    motion: FollowedOptions,
    clock: Annotated[
        Clock, typer.Option(help="real: on the wall clock; lockstep: for drivers that simulate in this process.")
    ] = "real",
    option: Annotated[
        list[str] | None, typer.Option("--option", "-o", metavar="KEY=VALUE", help="Option of the driver (repeatable).")
    ] = None,
    once: Annotated[
        bool,
        typer.Option(
            "--once", help="End when the motion is over, as --seconds does; without either the robot stays standing."
        ),
    ] = False,
    wait: Annotated[
        bool, typer.Option("--wait", help="Wait for a robot that is not there, or not switched on, and say so.")
    ] = False,
    run: RunOptions,
) -> None:
    """Stream a motion to a robot: stand up, follow, then stay standing until stopped.

    The command arms the robot: torque goes on at once. With --web or --stdin it waits for `flexmotion arm`, the page's
    button or a program (--arm: at once).

    Ctrl-C or SIGTERM brings the robot to a balanced stop, parks it and ends; a second one ends at once, torque off. The
    exit code after SIGTERM is 0 if the robot is parked. `flexmotion daemon` prints a systemd unit.
    SIGUSR1 is a stop (the robot stands), SIGUSR2 an emergency stop (what the robot file says; then it parks).

    [bold]Examples[/bold]

      flexmotion run --robot op3 --driver sim --prompt "walk forward"

      flexmotion run --robot op3 --driver sim --web

      flexmotion run --robot op3 --driver sim --mirror --web

      flexmotion run --robot op3 --driver sim --clip wave.bvh

      flexmotion run --robot op3 --driver sim --clip walk.bvh --once --report report
    """
    # From here on a signal is a request; while the rest is loaded, one for the end ends at once. Heavy imports wait
    # until the command runs: help and completion answer at once.
    from flexmotion.streamer.commands.signals import operator_signals

    with run.outputs():
        with operator_signals(loading=True) as signals:
            from flexmotion.configs.stream import load_stream
            from flexmotion.drivers.bus.options import ports_in
            from flexmotion.streamer.api import open_driver, open_robot
            from flexmotion.streamer.commands.driver_options import parse_options
            from flexmotion.streamer.commands.streaming import present, stream

            settings = load_stream(run.settings)
            run.check_ports(settings.gateway)
            stay = clock == "real" and not once and run.seconds is None
            chosen = open_robot(robot)
            options = parse_options(option or ())
            if port is not None:
                options |= ports_in(port)
            if driver == "sim":
                options["seed"] = motion.seed
            hardware = open_driver(driver, chosen, **options)
            # Before the motion, which takes long to load and to plan.
            _look(hardware, wait=wait)
            source = motion.followed(chosen, settings, run.seconds, endless=stay, listens=run.listens)
            signals.loading = False
            session = run.session(
                hardware,
                source,
                settings,
                clock=clock,
                seed=motion.seed,
                seconds=run.streamed_s(source, stay=stay),
                stay=stay,
                armed=not run.listens,
                mirror=motion.mirror_from(run.token_file),
            )
            session.waits = wait
            outcome = stream(session, signals)
        present(outcome, run.report, run.as_json, signals, video=run.video)


def _look(driver: Driver, *, wait: bool) -> None:
    """Check the robot before anything is prepared for it; nothing is written to it, and torque stays as it is.

    Args:
        wait: the robot need not be there yet.

    Raises:
        ConfigError: a servo is not configured.
        DriverError: a port or a servo does not answer.
    """
    from flexmotion.configs.errors import DriverError
    from flexmotion.drivers.bus.driver import BusDriver
    from flexmotion.streamer.checks.bus_check import check_buses
    from flexmotion.streamer.commands.output import print_note

    try:
        driver.look()
    except DriverError:
        if not wait:
            raise
    if isinstance(driver, BusDriver) and driver.turns == 1:  # servos that are read in turns keep up with any rate
        for bus in check_buses(driver.robot, driver.robot.rate_hz):
            if not bus.fits:
                print_note(
                    f"note: bus {bus.name}: {driver.robot.rate_hz:g} Hz does not fit, the highest rate is "
                    f"{bus.highest_hz:.0f} Hz: readings will be missed (`flexmotion check bus`)"
                )
