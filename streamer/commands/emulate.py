"""`flexmotion emulate`: a robot's servo bus on a pseudo-terminal."""

from __future__ import annotations

import math
import signal
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING, Annotated, Any

import typer

from flexmotion.streamer.commands.options import JsonOption, RobotOption, SeedOption
from flexmotion.streamer.commands.output import print_json, print_note, print_result

if TYPE_CHECKING:
    from flexmotion.drivers.emulator.emulator import Emulator


def emulate(
    robot: RobotOption = "op3",
    port_link: Annotated[
        Path | None,
        typer.Option("--port-link", help="Path of a symbolic link to the port.", show_default=False),
    ] = None,
    bench: Annotated[
        bool, typer.Option("--bench", help="Single servos on a bench, each with a flywheel, instead of a robot.")
    ] = False,
    timing: Annotated[bool, typer.Option("--timing/--no-timing", help="Bytes take time on the wire.")] = True,
    fault: Annotated[
        list[str] | None,
        typer.Option(
            "--fault",
            metavar="KIND[:ARG[:VALUE]][@S[+DURATION|+once]]",
            help="Fault to inject (repeatable), S seconds after torque goes on: lost, corrupt, late, duplicated, "
            "truncated, dead:ID, overheat:ID, voltage:V, reset:ID, cable, port, imu, echo, blocked:ID, tripped:ID; "
            "false readings, off by VALUE: false_position:SERVO:TICKS, false_speed, false_torque, false_voltage, "
            "false_temperature, false_gyro:VALUE, false_accel:VALUE.",
        ),
    ] = None,
    bad_packets: Annotated[
        float, typer.Option("--bad-packets", min=0, max=1, help="Share of packets that are faulty at random.")
    ] = 0.0,
    false_readings: Annotated[
        float, typer.Option("--false-readings", min=0, max=1, help="Share of readings that are false at random.")
    ] = 0.0,
    factory: Annotated[
        bool, typer.Option("--factory", help="Servos with factory settings, except id, bit rate and return delay.")
    ] = False,
    new: Annotated[
        list[str] | None,
        typer.Option("--new", metavar="JOINT", help="Its servo has factory settings, id and bit rate (repeatable)."),
    ] = None,
    perturb: Annotated[
        list[str] | None,
        typer.Option("--perturb", metavar="KEY=VALUE", help="How the robot differs from its model (repeatable)."),
    ] = None,
    perturbed: Annotated[
        bool, typer.Option("--perturbed", help="The standard mismatch: mass, delay, gains, friction, slope, pushes.")
    ] = False,
    realtime: Annotated[
        bool, typer.Option("--realtime/--no-realtime", help="Realtime scheduling where the system grants it.")
    ] = True,
    seconds: Annotated[
        float | None, typer.Option("--seconds", "-s", min=0.1, help="End after this time.", show_default=False)
    ] = None,
    seed: SeedOption = 0,
    as_json: JsonOption = False,
) -> None:
    """Emulate a robot's servo bus, byte by byte, on a pseudo-terminal; the simulated robot moves behind it.

    Any program that uses the servos' protocol can connect. Ctrl-C or SIGTERM ends it and prints its counts. The exit
    code is 0 even if the robot fell. Three seconds after all torque is off the robot stands as at the start again.

    [bold]Examples[/bold]

      flexmotion emulate --robot op3 --port-link /tmp/op3

      flexmotion run --robot op3 --driver dynamixel --port /tmp/op3 --clip walk.bvh

      flexmotion emulate --port-link /tmp/op3 --fault dead:14@5 --bad-packets 0.005
    """
    # Heavy imports wait until the command runs: help and completion answer at once.
    from flexmotion.configs.robot import load_robot
    from flexmotion.configs.schema import parse
    from flexmotion.drivers.emulator.body import BenchBody
    from flexmotion.drivers.emulator.build import build_emulator
    from flexmotion.drivers.emulator.faults import Fault
    from flexmotion.drivers.emulator.sim_body import SimBody
    from flexmotion.drivers.realtime.priority import ROBOT_PRIORITY, claim, settle
    from flexmotion.drivers.sim.options import SimOptions
    from flexmotion.streamer.commands.driver_options import simulation_options

    faults = [Fault.parse(text) for text in fault or ()]
    chosen = load_robot(robot)
    options = parse(SimOptions, simulation_options(perturbed, perturb or ()) | {"seed": seed}, "options of --perturb")
    body = BenchBody(chosen) if bench else SimBody(chosen, options)
    emulator = build_emulator(
        body,
        link=port_link,
        timed=timing,
        faults=faults,
        bad_packets=bad_packets,
        false_readings=false_readings,
        factory=factory,
        new=new or (),
        seed=seed,
    )
    with emulator, _ended_by_signals(emulator):
        for line in emulator.lines:
            print_note(f"{chosen.name}, {line.name}: {line.terminal.path}")
        settle(collect=False)
        claim(ROBOT_PRIORITY, allowed=realtime)
        emulator.run(float("inf") if seconds is None else seconds)
        figures = emulator.report()
    if as_json:
        print_json(figures)
    else:
        print_result(describe(figures, 1e3 / chosen.rate_hz))


@contextmanager
def _ended_by_signals(emulator: Emulator) -> Iterator[None]:
    """Context in which SIGINT and SIGTERM end the emulation."""

    def end(_number: int, _frame: FrameType | None) -> None:
        emulator.stop()

    before = {number: signal.signal(number, end) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def describe(figures: dict[str, Any], tick_ms: float) -> str:
    """The figures of `Emulator.report` in words.

    Args:
        tick_ms: period of the loop; an emulator that was later than this made the loop miss answers [ms].
    """
    lines = [_robot(figures)]
    lines += [f"{name}: {_line(counts)}" for name, counts in figures["buses"].items()]
    if figures["false_readings"]:
        told = ", ".join(f"{count} {kind.removeprefix('false_')}" for kind, count in figures["false_readings"].items())
        lines.append(f"false readings: {told}")
    late, lost = figures["lateness_ms"], figures["lost_ms"]
    given_up = f", {lost:.0f} ms of physics given up" if lost else ""
    lines.append(
        f"emulator: {figures['elapsed_s']:.1f} s, {100 * figures['processor_share']:.0f} % of a processor; "
        f"{late:.1f} ms late at worst while torque was on{given_up}"
    )
    if late > tick_ms:
        lines.append(
            f"It was later than a tick, {tick_ms:g} ms: if the driver reports that servos do not answer, this machine "
            "was too busy to emulate them in time."
        )
    return "\n".join(lines)


def _robot(figures: dict[str, Any]) -> str:
    outside = f"goals outside the envelope that arrived: {figures['violations']}"
    if "fell" not in figures:
        return f"servos: {outside}"
    how = "fell" if figures["fell"] else "did not fall"
    tilt, height = math.degrees(figures["steepest_tilt_rad"]), 100 * figures["lowest_height_share"]
    return (
        f"robot: {how}, tilted by {tilt:.1f}° at most, at its lowest {height:.0f} % of its height; "
        f"{figures['travelled_m']:.2f} m from where it began; {outside}"
    )


def _line(counts: dict[str, Any]) -> str:
    parts = [f"wire busy {100 * counts['wire_busy_share']:.0f} % of the time"]
    if "packets" in counts:
        packets = f"{counts['packets']} packets received, {counts['bad_packets']} of them broken"
        parts = [packets, f"{counts['collisions']} collisions", *parts]
    spoilt = ", ".join(f"{count} {kind}" for kind, count in counts["spoilt"].items())
    if counts.get("refused"):
        parts.append("refused: " + ", ".join(f"{count} {rule}" for rule, count in counts["refused"].items()))
    return ", ".join(parts) + (f"; injected faults: {spoilt}" if spoilt else "")
