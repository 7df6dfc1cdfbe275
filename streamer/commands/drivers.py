"""`flexmotion drivers`: the installed drivers and inertial sensors."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from rich.table import Table

from flexmotion.streamer.commands.options import JsonOption
from flexmotion.streamer.commands.output import print_json, print_result

if TYPE_CHECKING:
    from flexmotion.drivers.imu.interface import StandaloneImu
    from flexmotion.drivers.interface import Driver


def drivers(as_json: JsonOption = False) -> None:
    """List the installed drivers and inertial sensors; for one that does not load, stderr says why."""
    # Heavy imports wait until the command runs: help and completion answer at once.
    from flexmotion.drivers import registry
    from flexmotion.drivers.imu import registry as imus

    working, sensors = registry.available(), imus.available()
    rows = [_row("driver", name, working.get(name)) for name in registry.names()]
    rows += [_row("imu", name, sensors.get(name)) for name in imus.names()]
    if as_json:
        print_json(rows)
        return
    table = Table(box=None, pad_edge=False, header_style="dim")
    for column in ("name", "kind", "state", "from", "description"):
        table.add_column(column)
    for row in rows:
        state = "ready" if row["loads"] else "does not load"
        table.add_row(row["name"], row["kind"], state, row["class"], row["description"])
    print_result(table)


def _row(kind: str, name: str, driver: type[Driver] | type[StandaloneImu] | None) -> dict[str, Any]:
    description = (driver.__doc__ or "").strip().splitlines() if driver else []
    return {
        "name": name,
        "kind": kind,
        "loads": driver is not None,
        "class": f"{driver.__module__}.{driver.__qualname__}" if driver else "",
        "description": description[0] if description else "",
        "options": list(driver.Options.model_fields) if driver else [],
    }
