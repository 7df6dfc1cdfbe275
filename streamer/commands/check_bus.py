"""`flexmotion check bus`: whether the loop's rate fits the servo bus, and all servos match the robot file."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.table import Table

from flexmotion.configs.errors import FlexMotionError
from flexmotion.streamer.commands.bus_readout import PORTS_HELP, open_bench
from flexmotion.streamer.commands.exit_codes import CHECK_FAILED
from flexmotion.streamer.commands.options import JsonOption, RobotOption
from flexmotion.streamer.commands.output import print_json, print_result

if TYPE_CHECKING:
    from flexmotion.configs.robot import Robot

_MOST_READS = 5
"""Reads within which a servo answers that has lost an answer."""


def bus(
    robot: RobotOption = "op3",
    port: Annotated[
        str | None,
        typer.Option(
            "--port", "-p", metavar="PORT", help=f"Audit the servos on it too. {PORTS_HELP}", show_default=False
        ),
    ] = None,
    rate: Annotated[
        float | None, typer.Option("--rate", min=1, help="Loop rate \\[Hz]; the robot file's if not given.")
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Check whether the loop's rate fits the servo bus: bytes, baud rate and delays give the highest rate.

    With a port it also audits every servo as before a run; nothing is written. What it has read is printed also where
    the audit fails. Exit code 1 where the rate does not fit, 2 where a servo is not configured as the robot file says,
    3 where the port fails or a servo is missing.

    [bold]Examples[/bold]

      flexmotion check bus --robot op3

      flexmotion check bus --robot op3 --port /dev/ttyUSB0 --rate 200
    """
    # Heavy imports wait until the command runs: help and completion answer at once.
    from flexmotion.configs.robot import load_robot
    from flexmotion.streamer.checks.bus_check import check_buses

    chosen = load_robot(robot)
    wanted = chosen.rate_hz if rate is None else rate
    checks = check_buses(chosen, wanted)
    audit = Audit([], None) if port is None else _audit(chosen, port)
    fit = all(check.fits for check in checks)
    if as_json:
        buses = [
            {
                "bus": check.name,
                "baud": check.baud,
                "servos": check.servos,
                "read_bytes": check.budget.read_bytes,
                "write_bytes": check.budget.write_bytes,
                "read_ms": check.budget.read_s * 1e3,
                "write_ms": check.budget.write_s * 1e3,
                "highest_rate_hz": check.highest_hz,
                "fits": check.fits,
            }
            for check in checks
        ]
        content: dict[str, Any] = {"schema": "flexmotion.bus/1", "robot": chosen.name, "rate_hz": wanted}
        failure = None if audit.failure is None else str(audit.failure)
        print_json(
            content | {"ok": fit and failure is None, "buses": buses, "servos": audit.servos, "failure": failure}
        )
    else:
        table = Table(box=None, pad_edge=False, header_style="dim")
        for column in ("bus", "baud", "servos", "read", "write", "highest rate", f"{wanted:g} Hz"):
            table.add_column(column)
        for check in checks:
            budget = check.budget
            table.add_row(
                check.name,
                str(check.baud),
                str(check.servos),
                f"{budget.read_bytes} B, {budget.read_s * 1e3:.2f} ms",
                f"{budget.write_bytes} B, {budget.write_s * 1e3:.2f} ms",
                f"{check.highest_hz:.0f} Hz",
                "fits" if check.fits else "does not fit",
            )
        print_result(table)
        if audit.servos:
            print_result(_servo_table(audit.servos))
    if audit.failure is not None:
        raise audit.failure
    if not fit:
        raise typer.Exit(CHECK_FAILED)


@dataclass(frozen=True)
class Audit:
    """What an audit of the servos has found.

    Attributes:
        servos: every servo as it is now; None for what was not read. Empty if the port failed.
        failure: the first thing that is wrong: the port, a servo that is missing or another model, a setting.
    """

    servos: list[dict[str, Any]]
    failure: FlexMotionError | None


def _audit(robot: Robot, port: str) -> Audit:
    """Look at every servo. What is wrong is told after what was read."""
    import numpy as np

    from flexmotion.drivers.bus.inspection import refuse_unconfigured
    from flexmotion.drivers.interface import RobotState

    state = RobotState(robot.n)
    failure: FlexMotionError | None = None
    read = np.zeros(robot.n, bool)
    try:
        with open_bench(robot, port) as bench:
            try:
                refuse_unconfigured(bench.inspect())
            except FlexMotionError as error:
                failure = error
            for _ in range(_MOST_READS):
                bench.read(state)
                read |= state.stale == 0
                if read.all() and np.isfinite(state.voltage).all() and np.isfinite(state.temperature).all():
                    break
    except FlexMotionError as error:
        return Audit([], error)

    def number(index: int, value: float, digits: int) -> float | None:
        return round(float(value), digits) if read[index] and np.isfinite(value) else None

    servos = [
        {
            "joint": joint.name,
            "id": joint.id,
            "servo": joint.servo,
            "position_rad": number(index, state.position[index], 4),
            "voltage": number(index, state.voltage[index], 1),
            "temperature": number(index, state.temperature[index], 1),
            "hardware_error": int(state.hardware_error[index]) if read[index] else None,
        }
        for index, joint in enumerate(robot.joints)
    ]
    return Audit(servos, failure)


def _servo_table(audit: list[dict[str, Any]]) -> Table:
    table = Table(box=None, pad_edge=False, header_style="dim")
    for column in audit[0]:
        table.add_column(column.replace("_", " "))
    for row in audit:
        table.add_row(*("not read" if value is None else str(value) for value in row.values()))
    return table
