"""Finds drivers: built in, or installed by anyone under the entry-point group `flexmotion.drivers`.

An entry point names a subclass of `drivers.interface.Driver`. A plug-in that fails to import is reported and left out;
the others work.
"""

from __future__ import annotations

import logging
from importlib.metadata import EntryPoint, entry_points
from typing import Any

from configs.errors import ConfigError
from configs.robot import Robot
from configs.schema import parse
from drivers.interface import Driver

GROUP = "flexmotion.drivers"

BUILT_IN = {
    "dynamixel": "drivers.dynamixel.driver:DynamixelDriver",
    "feetech": "drivers.feetech.driver:FeetechDriver",
    "lx16a": "drivers.lx16a.driver:Lx16aDriver",
    "sim": "drivers.sim.driver:SimDriver",
}
"""The drivers of this project. They are entry points of its distribution too, but entry points exist only once
something is installed: this table lets a plain checkout find them. They win over plug-ins of the same name, so that
no package can slip in front of a driver that moves hardware."""

log = logging.getLogger(__name__)


def names() -> tuple[str, ...]:
    """Names of all registered drivers, whether or not they import."""
    return tuple(sorted(_entries()))


def available() -> dict[str, type[Driver]]:
    """Every driver that imports, by name; the others are logged as warnings."""
    drivers = {}
    for name, entry in sorted(_entries().items()):
        try:
            drivers[name] = _load(entry)
        except ConfigError as error:
            log.warning("%s", error)
    return drivers


def create(name: str, robot: Robot, **options: Any) -> Driver:
    """The driver `name` for a robot, not yet open; `options` are the fields of its `Options`.

    Raises `ConfigError` where there is no such driver, it does not import, or an option is wrong.
    """
    entries = _entries()
    if name not in entries:
        raise ConfigError(f"unknown driver {name!r}, expected one of: {', '.join(sorted(entries))}")
    driver = _load(entries[name])
    return driver(robot, options=parse(driver.Options, options, f"options of driver {name!r}"))


def _entries() -> dict[str, EntryPoint]:
    entries = {name: EntryPoint(name, value, GROUP) for name, value in BUILT_IN.items()}
    for entry in entry_points(group=GROUP):
        known = entries.setdefault(entry.name, entry)
        if known.value != entry.value:
            log.warning("driver %r of %s is ignored: %s has that name", entry.name, entry.value, known.value)
    return entries


def _load(entry: EntryPoint) -> type[Driver]:
    """The class that an entry point names. Raises `ConfigError` whatever a plug-in's import raises."""
    try:
        driver = entry.load()
    except Exception as error:
        reason = " ".join(str(error).split())
        raise ConfigError(
            f"driver {entry.name!r} ({entry.value}) does not load: {type(error).__name__}: {reason}"
        ) from error
    if not (isinstance(driver, type) and issubclass(driver, Driver)):
        raise ConfigError(f"driver {entry.name!r} ({entry.value}) is no subclass of drivers.interface.Driver")
    return driver
