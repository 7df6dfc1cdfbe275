"""Finds the bus driver for the servos of a robot."""

from __future__ import annotations

from flexmotion.configs.errors import ConfigError
from flexmotion.configs.robot import Robot
from flexmotion.drivers import registry
from flexmotion.drivers.bus.driver import BusDriver


def bus_driver_of(robot: Robot) -> type[BusDriver]:
    """The bus driver for the protocol of a robot's servos. Raises `ConfigError` unless exactly one protocol is used."""
    protocols = sorted({servo.protocol for servo in robot.servos})
    drivers = [driver for driver in registry.available().values() if issubclass(driver, BusDriver)]
    for driver in drivers:
        if protocols == [driver.Bus.protocol]:
            return driver
    known = ", ".join(sorted(driver.Bus.protocol for driver in drivers))
    raise ConfigError(f"{robot.file}: protocols of the servos: {', '.join(protocols)}, expected one of: {known}")
