"""`flexmotion servo adopt`: makes a factory-new servo the servo of a joint."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from flexmotion.configs.errors import DriverError
from flexmotion.streamer.commands.bus_readout import PortsOption, open_bench
from flexmotion.streamer.commands.options import JsonOption, RobotOption
from flexmotion.streamer.commands.output import print_json, print_note, print_result
from flexmotion.streamer.commands.servo_settings import YesOption

if TYPE_CHECKING:
    from flexmotion.configs.robot import Robot
    from flexmotion.drivers.bus.tools import BusTools


def adopt(
    joint: Annotated[str, typer.Option("--joint", "-j", help="Joint that the servo drives.")],
    port: PortsOption,
    robot: RobotOption = "op3",
    present_id: Annotated[
        int | None, typer.Option("--id", min=0, max=252, help="Its present id; that of a new servo if not given.")
    ] = None,
    present_baud: Annotated[
        int | None, typer.Option("--baud", "-b", help="Its present bit rate; that of a new servo if not given.")
    ] = None,
    yes: YesOption = False,
    backup: Annotated[
        Path | None,
        typer.Option("--backup", help="New file for its old settings; ROBOT-servos-DATE.yaml if not given."),
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Give a factory-new servo the id, bit rate and settings of a joint; the other servos may stay connected.

    Connect one new servo at a time. `flexmotion emulate --new l_knee` emulates one.

    [bold]Examples[/bold]

      flexmotion servo adopt --joint l_knee --port /dev/ttyUSB0 --robot ./my_robot
    """
    from flexmotion.configs.robot import load_robot
    from flexmotion.drivers.bus.inspection import refuse_locked
    from flexmotion.drivers.bus.settings_file import default_file, write_settings

    chosen = load_robot(robot)
    index = chosen.index(joint)
    config = chosen.joints[index]
    with open_bench(chosen, port, power=True) as bench:
        tools = bench.tools[config.bus]
        id_ = tools.new_id if present_id is None else present_id
        baud = tools.new_baud if present_baud is None else present_baud
        _refuse_taken(tools, chosen, index, id_, baud)
        rate = chosen.config.buses[config.bus].baud
        tools.port.set_baud(baud)
        _check_model(tools, chosen, index, id_)
        inspection = tools.inspect(chosen, index, id_)
        refuse_locked([inspection])
        plan = f"id {id_} at {baud} baud becomes id {config.id} at {rate} baud: {config.servo} of {joint}"
        if not yes and not typer.confirm(f"{plan}; write it?", err=True):
            print_note("nothing was written")
            raise typer.Abort
        file = default_file(chosen.name) if backup is None else backup
        write_settings(file, chosen.name, [replace(inspection, id=config.id)])  # it has this id when it is restored
        try:
            if id_ != config.id:
                tools.change_id(id_, config.id)
            if baud != rate:
                tools.write_baud(chosen, index, rate)
                tools.port.set_baud(rate)
            tools.acknowledge(chosen, [index])
            tools.write_settings(chosen, index, inspection.changes)
        except (DriverError, KeyboardInterrupt):
            print_note(
                f"a part may be written; `flexmotion servo scan` shows its id and bit rate, its old settings: {file}"
            )
            raise
    if as_json:
        print_json(
            {
                "joint": joint,
                "id": {"old": id_, "new": config.id},
                "baud": {"old": baud, "new": rate},
                "changes": {
                    name: {"old": inspection.held[name], "new": value} for name, value in inspection.changes.items()
                },
                "backup": str(file),
            }
        )
    else:
        print_result(f"{plan}; {len(inspection.changes)} settings written, old values: {file}")


def _refuse_taken(tools: BusTools, robot: Robot, index: int, id_: int, baud: int) -> None:
    """Raise `DriverError` if the joint has a servo already, or the new one cannot be told from another."""
    config = robot.joints[index]
    where, rate = f"port {tools.port.path}", robot.config.buses[config.bus].baud
    if (id_, baud) != (config.id, rate) and tools.answers(config.id):
        raise DriverError(f"{where}: id {config.id} answers at {rate} baud: {config.name} has a servo already")
    owner = next((j for j in robot.joints if j.bus == config.bus and j.id == id_ and j is not config), None)
    others = [j for j in robot.joints if j.bus == config.bus and j.id not in (id_, config.id)]
    if owner is not None and baud == rate and any(tools.answers(other.id) for other in others):
        raise DriverError(
            f"{where}: id {id_} at {baud} baud may be the servo of {owner.name}: connect the new servo alone"
        )


def _check_model(tools: BusTools, robot: Robot, index: int, id_: int) -> None:
    """Raise `DriverError` if no servo, or one of another model, has this id at the port's baud rate."""
    config = robot.joints[index]
    found = next((each for each in tools.scan_here() if each.id == id_), None)
    where = f"port {tools.port.path}: id {id_} at {tools.port.baud} baud"
    if found is None:
        raise DriverError(
            f"{where}: no servo answers; is it new? `flexmotion servo scan` finds it, then --id and --baud"
        )
    if config.servo not in found.model.split(" or "):
        raise DriverError(f"{where}: is {found.model}, {config.name} needs {config.servo}")
