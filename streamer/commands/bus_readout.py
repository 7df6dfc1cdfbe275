"""Reading a robot's servos for a command, with torque left as it is."""

from __future__ import annotations

import time
from contextlib import contextmanager
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from collections.abc import Iterator

    from flexmotion.configs.robot import Robot
    from flexmotion.drivers.bus.driver import BusDriver
    from flexmotion.drivers.interface import RobotState

PortOption = Annotated[str, typer.Option("--port", "-p", help="Port of the servo bus.")]

_TRIES = 25
"""Reads within which a joint must answer."""


@contextmanager
def open_readout(
    robot: Robot, port: str, *, imu: bool = False, imu_port: str | None = None, configure: bool = True
) -> Iterator[BusDriver]:
    """Context with an open driver; torque stays as it is, before and after.

    Args:
        imu: read the IMU too, on a port of its own if `imu_port` says so.
        configure: write the settings in which a servo differs from the robot file.

    Raises:
        DriverError: the port fails, or a servo is missing or not as the robot file says.
    """
    from flexmotion.drivers.bus.finder import bus_driver_of
    from flexmotion.drivers.bus.options import BusOptions

    options = BusOptions(port=port, imu=imu, imu_port=imu_port, configure=configure)
    driver = bus_driver_of(robot)(robot, options=options)
    driver.open()
    try:
        yield driver
    finally:
        driver.let_go()


def read_until_fresh(driver: BusDriver, state: RobotState, index: int) -> bool:
    """Read until a joint has answered; returns whether it did.

    It reads at the loop's rate: after a longer pause the driver cannot tell an old answer from a new one.
    """
    for _ in range(_TRIES):
        driver.read(state)
        if not state.stale[index]:
            return True
        time.sleep(1.0 / driver.robot.rate_hz)
    return False
