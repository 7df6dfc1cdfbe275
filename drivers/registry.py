"""Finds drivers: built-in ones, and plug-ins in the entry-point group `flexmotion.drivers`."""

from __future__ import annotations

from typing import Any

from flexmotion.configs.errors import ConfigError
from flexmotion.configs.robot import Robot
from flexmotion.configs.schema import parse
from flexmotion.drivers.interface import Driver
from flexmotion.drivers.plugins import PlugIns
from flexmotion.drivers.simulated import LockstepDriver, SimulatedDriver

GROUP = "flexmotion.drivers"

BUILT_IN = {
    "dynamixel": "flexmotion.drivers.dynamixel.driver:DynamixelDriver",
    "feetech": "flexmotion.drivers.feetech.driver:FeetechDriver",
    "lx16a": "flexmotion.drivers.lx16a.driver:Lx16aDriver",
    "sim": "flexmotion.drivers.sim.driver:SimDriver",
}

_DRIVERS: PlugIns[Driver] = PlugIns(GROUP, "driver", Driver, BUILT_IN)  # type: ignore[type-abstract]


def names() -> tuple[str, ...]:
    """Names of all registered drivers, whether or not they can be imported."""
    return _DRIVERS.names()


def available() -> dict[str, type[Driver]]:
    """Every driver that can be imported, by name; a warning is logged for each of the others."""
    return _DRIVERS.available()


def create(name: str, robot: Robot, **options: Any) -> Driver:
    """Create the driver `name` for a robot, not yet open; `options` are the fields of its `Options`.

    Raises `ConfigError` if there is no such driver, it cannot be imported, an option is wrong, or it promises a
    capability of a simulated robot without its base class.
    """
    kind = _DRIVERS.get(name)
    driver = kind(robot, options=parse(kind.Options, options, f"options of driver {name!r}"))
    for capability, base in (("truth", SimulatedDriver), ("lockstep", LockstepDriver)):
        if getattr(driver.capabilities, capability) and not isinstance(driver, base):
            raise ConfigError(f"driver {name!r}: capability {capability} needs the base class {base.__name__}")
    return driver
