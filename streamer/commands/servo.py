"""`flexmotion servo`: single servos at the bench."""

from __future__ import annotations

import time
from contextlib import contextmanager
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer
from rich.live import Live
from rich.table import Table

from streamer.commands.options import JsonOption, RobotOption
from streamer.commands.output import print_json, print_result

if TYPE_CHECKING:
    from collections.abc import Iterator

    from configs.robot import Robot
    from drivers.bus.driver import BusDriver
    from drivers.bus.tools import BusTools
    from drivers.interface import RobotState

ProtocolName = Literal["dynamixel2", "feetech", "lx16a"]

PortOption = Annotated[str, typer.Option("--port", "-p", help="Port of the servo bus.")]
ProtocolOption = Annotated[ProtocolName, typer.Option("--protocol", help="What the servos speak.")]
BaudOption = Annotated[int, typer.Option("--baud", "-b", help="Bit rate of the bus.")]
IdArgument = Annotated[int, typer.Argument(min=0, max=252, help="Id of the servo.")]

servo = typer.Typer(no_args_is_help=True)


@servo.callback()
def _servos() -> None:
    """Find, name, calibrate, restart and watch servos on a bus."""


@servo.command()
def scan(
    port: PortOption,
    protocol: ProtocolOption = "dynamixel2",
    baud: Annotated[
        list[int] | None, typer.Option("--baud", "-b", help="Bit rate to try (repeatable); all that there are if none.")
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Find every servo on a port, at every baud rate.

    [bold]Examples[/bold]

      flexmotion servo scan --port /dev/ttyUSB0

      flexmotion servo scan --port /dev/ttyUSB0 --protocol feetech --baud 1000000
    """
    kind = _tools(protocol)
    with _open(kind, port, (baud or kind.baud_rates)[0]) as tools:
        found = list(tools.scan(tuple(baud or kind.baud_rates)))
    if as_json:
        print_json([vars(each) for each in found])
        return
    table = Table(box=None, pad_edge=False, header_style="dim")
    for column in ("baud", "id", "model", "firmware"):
        table.add_column(column)
    for each in found:
        table.add_row(str(each.baud), str(each.id), each.model, "" if each.firmware is None else str(each.firmware))
    print_result(table if found else "nobody answers: is the servos' power on?")


@servo.command("set-id")
def set_id(
    old: IdArgument,
    new: Annotated[int, typer.Argument(min=0, max=252, help="Id that it shall have.")],
    port: PortOption,
    baud: BaudOption,
    protocol: ProtocolOption = "dynamixel2",
) -> None:
    """Give a servo another id; refused where somebody has it, or while its torque is on.

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
    """Restart a servo, as one in shutdown needs: its torque goes off. Hold the robot.

    [bold]Examples[/bold]

      flexmotion servo reboot 14 --port /dev/ttyUSB0 --baud 2000000
    """
    with _open(_tools(protocol), port, baud) as tools:
        tools.reboot(id_)
    print_result(f"id {id_} restarts")


@servo.command()
def watch(
    port: PortOption,
    robot: RobotOption = "op3",
    seconds: Annotated[
        float | None, typer.Option("--seconds", "-s", min=0.1, help="End after this time.", show_default=False)
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Show every servo's angle, torque, supply and temperature, live; torque stays as it is.

    With --json one object on the last values, when it ends.

    [bold]Examples[/bold]

      flexmotion servo watch --port /dev/ttyUSB0 --robot op3
    """
    from configs.robot import load_robot
    from drivers.interface import RobotState

    chosen = load_robot(robot)
    state = RobotState(chosen.n)
    end = time.monotonic() + (float("inf") if seconds is None else seconds)
    with _looking(chosen, port) as driver, Live(auto_refresh=False, transient=as_json) as live:
        while True:
            driver.read(state)
            if not as_json:
                live.update(_state_table(chosen, state), refresh=True)
            if time.monotonic() >= end:
                break
            time.sleep(0.1)
    if as_json:
        print_json(_rows(chosen, state))


@contextmanager
def _open(kind: type[BusTools], port: str, baud: int) -> Iterator[BusTools]:
    from drivers.bus.port import SerialPort

    line = SerialPort(port, baud)
    try:
        yield kind(line)
    finally:
        line.close()


def _tools(protocol: ProtocolName) -> type[BusTools]:
    # Heavy imports wait until the command runs: help and completion answer at once.
    from drivers.dynamixel.tools import DynamixelTools
    from drivers.feetech.tools import FeetechTools
    from drivers.lx16a.tools import Lx16aTools

    return {kind.protocol: kind for kind in (DynamixelTools, FeetechTools, Lx16aTools)}[protocol]


@contextmanager
def _looking(robot: Robot, port: str) -> Iterator[BusDriver]:
    """An open driver that leaves torque as it is."""
    from drivers.bus.finder import bus_driver_of
    from drivers.bus.options import BusOptions

    driver = bus_driver_of(robot)(robot, options=BusOptions(port=port))
    driver.open()
    try:
        yield driver
    finally:
        driver.let_go()


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
            "hardware_error": int(state.hardware_error[index]),
            "missed_reads": int(state.stale[index]),
        }
        for index, joint in enumerate(robot.joints)
    ]


def _state_table(robot: Robot, state: RobotState) -> Table:
    table = Table(box=None, pad_edge=False, header_style="dim")
    rows = _rows(robot, state)
    for column in rows[0]:
        table.add_column(column.replace("_", " "))
    for row in rows:
        table.add_row(*("" if value is None else str(value) for value in row.values()))
    return table
