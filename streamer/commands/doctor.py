"""`flexmotion doctor`: whether this machine can run a robot, and the commands that mend it."""

from __future__ import annotations

import typer
from rich.table import Table

from flexmotion.streamer.commands.exit_codes import CHECK_FAILED
from flexmotion.streamer.commands.options import BundleOption, JsonOption, SettingsOption
from flexmotion.streamer.commands.output import print_json, print_result


def doctor(bundle: BundleOption = None, settings: SettingsOption = None, as_json: JsonOption = False) -> None:
    """Examine this machine: scheduling, memory, processors, clocks, serial adapters, rights, model, ports.

    Each finding comes with the command that mends it. Exit code 1 where something keeps a robot from running, or from
    running safely; warnings name drawbacks.

    [bold]Examples[/bold]

      flexmotion doctor

      flexmotion doctor --json
    """
    # Heavy imports wait until the command runs: help and completion answer at once.
    from flexmotion.configs.stream import load_stream
    from flexmotion.streamer.doctor.doctor import examine

    found = examine(load_stream(settings).gateway, bundle)
    if as_json:
        print_json(found.model_dump(by_alias=True))
    else:
        table = Table(box=None, pad_edge=False, header_style="dim")
        for column in ("", "what", "found"):
            table.add_column(column)
        for one in found.findings:
            table.add_row(one.level, one.subject, one.found)
            if one.mend is not None:
                table.add_row("", "", f"→ {one.mend}")
        print_result(table)
    if not found.ok:
        raise typer.Exit(CHECK_FAILED)
