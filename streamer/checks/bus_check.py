"""The highest loop rate that a robot's servo buses allow, calculated from the robot file."""

from __future__ import annotations

from dataclasses import dataclass

from flexmotion.configs.robot import Robot
from flexmotion.drivers.bus.driver import READ_SHARE
from flexmotion.drivers.bus.finder import bus_driver_of
from flexmotion.drivers.bus.servo_bus import Budget

ADAPTER_S = 0.0005
"""Time that a serial adapter adds to a read, beyond the wire (assumption: low-latency mode) [s]."""

CYCLE_SHARE = 0.8
"""Share of a tick that reading and writing may take together; the rest is the loop's."""


@dataclass(frozen=True)
class BusCheck:
    """One bus.

    Attributes:
        name: name in the robot file.
        baud: bit rate.
        servos: number of servos.
        budget: bytes and time of a cycle.
        highest_hz: highest loop rate at which a cycle fits into a tick.
        fits: whether the requested rate does not exceed it.
    """

    name: str
    baud: int
    servos: int
    budget: Budget
    highest_hz: float
    fits: bool


def check_buses(robot: Robot, rate_hz: float) -> list[BusCheck]:
    """Check every bus of a robot at a loop rate. Raises `ConfigError` if no driver supports its servos."""
    driver = bus_driver_of(robot)
    checks = []
    for name, config in robot.config.buses.items():
        driver.Bus.check(robot, name)
        budget = driver.Bus.budget(robot, name)
        read_hz = READ_SHARE / (budget.read_s + ADAPTER_S)
        cycle_hz = CYCLE_SHARE / (budget.cycle_s + ADAPTER_S)
        highest = min(read_hz, cycle_hz)
        servos = sum(joint.bus == name for joint in robot.joints)
        checks.append(BusCheck(name, config.baud, servos, budget, highest, rate_hz <= highest))
    return checks
