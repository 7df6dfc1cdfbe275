"""`flexmotion drivers`: what drivers are installed."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from rich.table import Table

from streamer.commands.options import JsonOption
from streamer.commands.output import print_json, print_result

if TYPE_CHECKING:
    from drivers.interface import Driver


def drivers(as_json: JsonOption = False) -> None:
    """List the drivers that are installed; one that does not load is named, and why on stderr."""
    # Heavy imports wait until the command runs: help and completion answer at once.
    from drivers import registry

    working = registry.available()
    rows = [_row(name, working.get(name)) for name in registry.names()]
    if as_json:
        print_json(rows)
        return
    table = Table(box=None, pad_edge=False, header_style="dim")
    for column in ("driver", "state", "from", "description"):
        table.add_column(column)
    for row in rows:
        table.add_row(row["name"], "ready" if row["loads"] else "does not load", row["class"], row["description"])
    print_result(table)


def _row(name: str, driver: type[Driver] | None) -> dict[str, Any]:
    description = (driver.__doc__ or "").strip().splitlines() if driver else []
    return {
        "name": name,
        "loads": driver is not None,
        "class": f"{driver.__module__}.{driver.__qualname__}" if driver else "",
        "description": description[0] if description else "",
        "options": list(driver.Options.model_fields) if driver else [],
    }
