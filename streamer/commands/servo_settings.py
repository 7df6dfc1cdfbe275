"""`flexmotion servo configure` and `restore`: settings that servos keep without power."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.table import Table

from flexmotion.configs.errors import ConfigError, DriverError
from flexmotion.streamer.commands.bus_readout import PortsOption, open_bench
from flexmotion.streamer.commands.exit_codes import CHECK_FAILED
from flexmotion.streamer.commands.options import JsonOption, RobotOption
from flexmotion.streamer.commands.output import print_json, print_note, print_result

if TYPE_CHECKING:
    from collections.abc import Sequence

    from flexmotion.drivers.bus.inspection import Inspection

YesOption = Annotated[bool, typer.Option("--yes", "-y", help="Write without asking.")]

Changes = dict[str, dict[str, int]]
"""Joint -> setting -> new value."""


def configure(
    port: PortsOption,
    robot: RobotOption = "op3",
    check: Annotated[
        bool, typer.Option("--check", help="Only show what differs; exit code 1 if anything does.")
    ] = False,
    yes: YesOption = False,
    backup: Annotated[
        Path | None,
        typer.Option("--backup", help="New file for the old values; ROBOT-servos-DATE.yaml if not given."),
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Write the settings that every servo must have for the robot file, and keeps without power.

    All servos are read first: if one is missing, another model, or has torque on, nothing is written. Then the old and
    new values are shown, and the old ones stored in a file from which `servo restore` brings them back.

    [bold]Examples[/bold]

      flexmotion servo configure --port /dev/ttyUSB0 --robot ./my_robot
    """
    from flexmotion.configs.robot import load_robot

    chosen = load_robot(robot)
    with open_bench(chosen, port, power=not check) as bench:
        if not check:
            bench.acknowledge()
        inspections = bench.inspect()
        changes = {each.joint: each.changes for each in inspections if each.changes}
        if not changes:
            _report(as_json, inspections, changes, "every servo is configured, nothing was written")
            return
        if check:
            _report(as_json, inspections, changes, "nothing was written")
            raise typer.Exit(CHECK_FAILED)
        _change(bench, inspections, changes, yes=yes, backup=backup, as_json=as_json)


def restore(
    file: Annotated[Path, typer.Argument(help="File of old values that `servo configure` has stored.")],
    port: PortsOption,
    robot: RobotOption = "op3",
    yes: YesOption = False,
    backup: Annotated[
        Path | None,
        typer.Option("--backup", help="New file for the present values; ROBOT-servos-DATE.yaml if not given."),
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Write the settings back that servos had before `servo configure` or `servo adopt`.

    Only the servos in the file must be connected. Ids and bit rates stay as they are.

    [bold]Examples[/bold]

      flexmotion servo restore op3-servos-20260101T120000Z.yaml --port /dev/ttyUSB0 --robot op3
    """
    from flexmotion.configs.robot import load_robot
    from flexmotion.drivers.bus.settings_file import read_settings

    chosen = load_robot(robot)
    kept = read_settings(file, chosen.name)
    with open_bench(chosen, port, power=True) as bench:
        bench.acknowledge()
        inspections = bench.inspect(list(kept.joints))
        now = {each.joint: each for each in inspections}
        changes: Changes = {}
        for joint, old in kept.joints.items():
            each = now.get(joint)
            if each is None or (each.id, each.servo) != (old.id, old.servo):
                found = "no such joint" if each is None else f"{each.servo} (id {each.id})"
                raise ConfigError(f"{file}: joint {joint!r}: {old.servo} (id {old.id}), the robot has {found}")
            unknown = set(old.settings) - set(each.held)
            if unknown:
                known = ", ".join(each.held)
                raise ConfigError(
                    f"{file}: joint {joint!r}: unknown setting {min(unknown)!r}, expected one of: {known}"
                )
            differs = {name: value for name, value in old.settings.items() if each.held[name] != value}
            if differs:
                changes[joint] = differs
        if not changes:
            _report(as_json, inspections, changes, "the servos have these settings, nothing was written")
            return
        _change(bench, inspections, changes, yes=yes, backup=backup, as_json=as_json)


def _change(
    bench: Any, inspections: Sequence[Inspection], changes: Changes, *, yes: bool, backup: Path | None, as_json: bool
) -> None:
    """Show the changes, ask, store the old values, write."""
    from flexmotion.drivers.bus.inspection import refuse_locked
    from flexmotion.drivers.bus.settings_file import default_file, write_settings

    refuse_locked([each for each in inspections if each.joint in changes])
    if not as_json:
        print_result(_table(inspections, changes))
    if not yes and not typer.confirm("write these settings?", err=True):
        print_note("nothing was written")
        raise typer.Exit(CHECK_FAILED)
    file = default_file(bench.robot.name) if backup is None else backup
    write_settings(file, bench.robot.name, inspections)
    print_note(f"old values: {file}")
    try:
        bench.write(inspections, changes)
    except (DriverError, KeyboardInterrupt):
        print_note(f"a part may be written; `flexmotion servo restore {file}` writes the old values back")
        raise
    if as_json:
        print_json(_json(inspections, changes) | {"written": True, "backup": str(file)})
    else:
        count = sum(len(settings) for settings in changes.values())
        print_result(f"{count} settings of {len(changes)} servos written; old values: {file}")


def _report(as_json: bool, inspections: Sequence[Inspection], changes: Changes, text: str) -> None:
    if as_json:
        print_json(_json(inspections, changes) | {"written": False, "backup": None})
        return
    if changes:
        print_result(_table(inspections, changes))
    print_result(text)


def rows(inspections: Sequence[Inspection], changes: Changes) -> list[dict[str, Any]]:
    """One row for each setting that changes, with its old and new value."""
    return [
        {"joint": each.joint, "id": each.id, "setting": name, "old": each.held[name], "new": value}
        for each in inspections
        for name, value in changes.get(each.joint, {}).items()
    ]


def _json(inspections: Sequence[Inspection], changes: Changes) -> dict[str, Any]:
    return {"schema": "flexmotion.servo_settings/1", "changes": rows(inspections, changes)}


def _table(inspections: Sequence[Inspection], changes: Changes) -> Table:
    table = Table(box=None, pad_edge=False, header_style="dim")
    for column in ("joint", "id", "setting", "old", "new"):
        table.add_column(column)
    for row in rows(inspections, changes):
        table.add_row(*(str(value) for value in row.values()))
    return table
