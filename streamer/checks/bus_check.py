"""What a robot's servo buses have time for, calculated from the robot file."""

from __future__ import annotations

from dataclasses import dataclass

from flexmotion.configs.robot import Robot
from flexmotion.drivers.bus.driver import READ_SHARE
from flexmotion.drivers.bus.finder import bus_driver_of
from flexmotion.drivers.bus.servo_bus import Budget

ADAPTER_S = 0.0005
"""Time that an adapter and its driver add to reading, beyond the wire (assumption: low-latency mode) [s]."""

CYCLE_SHARE = 0.8
"""Share of a tick that reading and writing may take together; the rest is for the loop itself."""


@dataclass(frozen=True)
class BusCheck:
    """One bus.

    Attributes:
        name: in the robot file; `baud` its bit rate; `servos` on it.
        budget: bytes and time of a cycle.
        highest_hz: loop rate up to which that fits a tick.
        fits: whether the rate asked for does.
    """

    name: str
    baud: int
    servos: int
    budget: Budget
    highest_hz: float
    fits: bool


def check_buses(robot: Robot, rate_hz: float) -> list[BusCheck]:
    """Every bus of a robot at a loop rate. Raises `ConfigError` where no driver speaks to its servos."""
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
