"""Finds drivers: built in, or installed by anyone under the entry-point group `flexmotion.drivers`."""

from __future__ import annotations

from typing import Any

from configs.robot import Robot
from configs.schema import parse
from drivers.interface import Driver
from drivers.plugins import PlugIns

GROUP = "flexmotion.drivers"

BUILT_IN = {
    "dynamixel": "drivers.dynamixel.driver:DynamixelDriver",
    "feetech": "drivers.feetech.driver:FeetechDriver",
    "lx16a": "drivers.lx16a.driver:Lx16aDriver",
    "sim": "drivers.sim.driver:SimDriver",
}

_DRIVERS: PlugIns[Driver] = PlugIns(GROUP, "driver", Driver, BUILT_IN)  # type: ignore[type-abstract]


def names() -> tuple[str, ...]:
    """Names of all registered drivers, whether or not they import."""
    return _DRIVERS.names()


def available() -> dict[str, type[Driver]]:
    """Every driver that imports, by name; the others are logged as warnings."""
    return _DRIVERS.available()


def create(name: str, robot: Robot, **options: Any) -> Driver:
    """The driver `name` for a robot, not yet open; `options` are the fields of its `Options`.

    Raises `ConfigError` where there is no such driver, it does not import, or an option is wrong.
    """
    driver = _DRIVERS.get(name)
    return driver(robot, options=parse(driver.Options, options, f"options of driver {name!r}"))
