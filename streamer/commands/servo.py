"""`flexmotion servo`: single servos at the bench."""

from __future__ import annotations

import math
import time
from contextlib import contextmanager
from typing import TYPE_CHECKING, Annotated, Any, Literal, get_args

import typer
from rich.live import Live
from rich.table import Table

from flexmotion.streamer.commands.bus_readout import PortOption, PortsOption, open_bench
from flexmotion.streamer.commands.exit_codes import CHECK_FAILED, HARDWARE_FAILED, INTERRUPTED
from flexmotion.streamer.commands.options import JsonOption, RobotOption
from flexmotion.streamer.commands.output import print_json, print_note, print_result

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from flexmotion.configs.robot import Robot
    from flexmotion.drivers.bus.tools import BusTools, Found
    from flexmotion.drivers.interface import RobotState

ProtocolName = Literal["dynamixel2", "feetech", "lx16a"]

ProtocolOption = Annotated[ProtocolName, typer.Option("--protocol", help="Protocol of the servos.")]
BaudOption = Annotated[int, typer.Option("--baud", "-b", help="Bit rate of the bus.")]
IdArgument = Annotated[int, typer.Argument(min=0, max=252, help="Id of the servo.")]

_SHOWN_EVERY_S, _PAUSE_S = 0.1, 0.01
"""Period of the picture, and pause between two reads of all servos [s]."""

_LIMITS = {"min_position_limit", "max_position_limit"}
"""Settings of a servo that never change which angle it reports."""

servo = typer.Typer(no_args_is_help=True)


@servo.callback()
def _servos() -> None:
    """Find, watch, name, configure, calibrate, identify and restart servos on a bus."""


@servo.command()
def scan(
    port: PortOption,
    protocol: ProtocolOption = "dynamixel2",
    baud: Annotated[
        list[int] | None, typer.Option("--baud", "-b", help="Bit rate to try (repeatable); all of them if not given.")
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Find every servo on a port, at every baud rate. Exit code 1 where no servo answers.

    [bold]Examples[/bold]

      flexmotion servo scan --port /dev/ttyUSB0

      flexmotion servo scan --port /dev/ttyUSB0 --protocol feetech --baud 1000000
    """
    kind = _tools(protocol)
    found: list[Found] = []
    with _open(kind, port, (baud or kind.baud_rates)[0]) as tools:
        for rate in baud or kind.baud_rates:
            print_note(f"{rate} baud …")
            found += tools.scan((rate,))
    if as_json:
        print_json([vars(each) for each in found])
    elif found:
        print_result(_found(found))
    else:
        others = ", ".join(other for other in get_args(ProtocolName) if other != protocol)
        print_note(f"no servo of {protocol} answers: is their power on? is the port right? other --protocol: {others}")
        if other := [rate for rate in baud or () if rate not in kind.baud_rates]:
            rates, those = ", ".join(map(str, kind.baud_rates)), ", ".join(map(str, other))
            print_note(f"--baud {those}: no rate of servos of {protocol}, theirs are {rates}")
    if not found:
        raise typer.Exit(CHECK_FAILED)


def _found(found: Sequence[Found]) -> Table:
    table = Table(box=None, pad_edge=False, header_style="dim")
    for column in ("baud", "id", "model", "firmware"):
        table.add_column(column)
    for each in found:
        table.add_row(str(each.baud), str(each.id), each.model, "" if each.firmware is None else str(each.firmware))
    return table


@servo.command("set-id")
def set_id(
    old: IdArgument,
    new: Annotated[int, typer.Argument(min=0, max=252, help="New id.")],
    port: PortOption,
    baud: BaudOption,
    protocol: ProtocolOption = "dynamixel2",
) -> None:
    """Change a servo's id; refused while another servo has it, or while its torque is on.

    [bold]Examples[/bold]

      flexmotion servo set-id 1 14 --port /dev/ttyUSB0 --baud 57600
    """
    with _open(_tools(protocol), port, baud) as tools:
        tools.change_id(old, new)
    print_result(f"id {old} is {new} now")


@servo.command()
def reboot(
    id_: Annotated[int, typer.Argument(metavar="ID", min=0, max=252, help="Id of the servo.")],
    port: PortOption,
    baud: BaudOption,
    protocol: ProtocolOption = "dynamixel2",
) -> None:
    """Restart a servo, to clear a shutdown: its torque goes off. Hold the robot.

    [bold]Examples[/bold]

      flexmotion servo reboot 14 --port /dev/ttyUSB0 --baud 2000000
    """
    with _open(_tools(protocol), port, baud) as tools:
        tools.reboot(id_)
    print_result(f"id {id_} has restarted, its torque is off")


@servo.command()
def watch(
    port: PortsOption,
    robot: RobotOption = "op3",
    seconds: Annotated[
        float | None, typer.Option("--seconds", "-s", min=0.1, help="End after this time.", show_default=False)
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Show every servo's angle, torque, supply and temperature, live; nothing is written to them.

    Exit code 3 where a servo is missing or another model; the others are shown.

    With --json it prints the last values at its end, one object a joint: after --seconds, or with Ctrl-C.

    [bold]Examples[/bold]

      flexmotion servo watch --port /dev/ttyUSB0 --robot op3
    """
    from flexmotion.configs.robot import load_robot
    from flexmotion.drivers.interface import RobotState

    chosen = load_robot(robot)
    state = RobotState(chosen.n)
    state.values.fill(float("nan"))  # what is never read is not shown as 0
    now, interrupted = time.monotonic(), False
    end, shown = now + (float("inf") if seconds is None else seconds), now
    with open_bench(chosen, port, imu=False) as bench, Live(auto_refresh=False, transient=as_json) as live:
        found, missing = bench.inspect_what_answers()
        if not found:
            raise missing[0]
        for error in missing:
            print_note(str(error))
        for each in found:
            if each.changes:
                names = ", ".join(f"{name} {each.held[name]} (wanted {value})" for name, value in each.changes.items())
                wrong = ", the angle shown may be wrong" if set(each.changes) - _LIMITS else ""
                print_note(f"{each.where}: is not configured{wrong}: {names}")
        try:
            while now < end:
                bench.read(state)
                if now >= shown and not as_json:
                    live.update(_state_table(chosen, state), refresh=True)
                    shown = now + _SHOWN_EVERY_S
                time.sleep(_PAUSE_S)
                now = time.monotonic()
        except KeyboardInterrupt:
            interrupted = True
    if not as_json and not live.console.is_terminal:
        live.console.line()  # a file gets the last table, without its line feed
    if as_json:
        print_json(_rows(chosen, state))
    if interrupted:
        raise typer.Exit(INTERRUPTED)
    if missing:
        raise typer.Exit(HARDWARE_FAILED)


@contextmanager
def _open(kind: type[BusTools], port: str, baud: int) -> Iterator[BusTools]:
    from flexmotion.drivers.port import SerialPort

    line = SerialPort(port, baud)
    try:
        line.refuse_echo()
        yield kind(line)
    finally:
        line.close()


def _tools(protocol: ProtocolName) -> type[BusTools]:
    # Heavy imports wait until the command runs: help and completion answer at once.
    from flexmotion.drivers.bench import TOOLS

    return TOOLS[protocol]


def _rows(robot: Robot, state: RobotState) -> list[dict[str, Any]]:
    def number(value: float) -> float | None:
        return round(float(value), 4) if value == value else None

    return [
        {
            "joint": joint.name,
            "id": joint.id,
            "position_rad": number(state.position[index]),
            "torque_nm": number(state.effort[index]),
            "voltage": number(state.voltage[index]),
            "temperature": number(state.temperature[index]),
            "hardware_error": None if math.isnan(state.position[index]) else int(state.hardware_error[index]),
            "missed_reads": int(state.stale[index]),
        }
        for index, joint in enumerate(robot.joints)
    ]


def _state_table(robot: Robot, state: RobotState) -> Table:
    table = Table(box=None, pad_edge=False, header_style="dim")
    rows = _rows(robot, state)
    joints = max(len(row["joint"]) for row in rows)
    for column in rows[0]:
        words = column.split("_")
        # A narrow terminal may break headers between words; a joint that is cut could be either of two.
        table.add_column(" ".join(words), min_width=joints if column == "joint" else max(map(len, words)))
    for row in rows:
        table.add_row(*("" if value is None else str(value) for value in row.values()))
    return table
