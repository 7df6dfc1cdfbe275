"""Robots and simulated drivers for the tests of this folder."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator

import numpy as np
import pytest

from flexmotion.configs.robot import Robot, load_robot
from flexmotion.drivers.emulator.body import BenchBody
from flexmotion.drivers.emulator.build import build_emulator
from flexmotion.drivers.emulator.emulator import Emulator
from flexmotion.drivers.interface import JointCommand, RobotState
from flexmotion.drivers.sim.driver import SimDriver
from flexmotion.drivers.sim.options import SimOptions

TICK = 0.008


@pytest.fixture(scope="session")
def op3() -> Robot:
    return load_robot("op3")


class Run:
    """A driver and the loop around it, tick by tick.

    Attributes:
        driver, state, command: the driver and its messages.
    """

    def __init__(self, driver: SimDriver) -> None:
        self.driver = driver
        self.state, self.command = RobotState(driver.robot.n), JointCommand(driver.robot.n)
        self.command.position[:] = driver.robot.stand_pose

    def tick(self, ticks: int = 1) -> None:
        for _ in range(ticks):
            self.driver.read(self.state)
            self.driver.write(self.command)
            self.driver.advance(TICK)
        self.driver.read(self.state)

    @property
    def tilt(self) -> float:
        """Angle between the torso's up and the world's [rad]."""
        _, x, y, _ = self.driver.truth().base_quaternion
        return float(np.arccos(1 - 2 * (x * x + y * y)))


@pytest.fixture
def start(op3: Robot) -> Iterator[Callable[..., Run]]:
    """Call with fields of `SimOptions`; an open driver with torque on (`torque=False`: off)."""
    drivers = []

    def make(*, torque: bool = True, robot: Robot = op3, **options: object) -> Run:
        driver = SimDriver(robot, options=SimOptions.model_validate(options))
        drivers.append(driver)
        driver.open()
        if torque:
            driver.set_torque(True)
        return Run(driver)

    yield make
    for driver in drivers:
        driver.close()


@pytest.fixture
def emulated(op3: Robot) -> Iterator[Callable[..., Emulator]]:
    """Call with arguments of `build_emulator`: an emulator in a thread, servos on a bench."""
    running: list[tuple[Emulator, threading.Thread]] = []

    def make(robot: Robot = op3, **arguments: object) -> Emulator:
        emulator = build_emulator(BenchBody(robot), **arguments)  # type: ignore[arg-type]
        thread = threading.Thread(target=emulator.run, daemon=True)
        thread.start()
        running.append((emulator, thread))
        return emulator

    yield make
    for emulator, thread in running:
        emulator.stop()
        thread.join()
        emulator.close()
