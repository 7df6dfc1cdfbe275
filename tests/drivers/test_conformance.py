"""Every driver of the project passes the conformance suite."""

from __future__ import annotations

from pathlib import Path

import pytest

from flexmotion.configs.robot import Robot, load_robot
from flexmotion.drivers.bus.driver import BusDriver
from flexmotion.drivers.conformance import DriverConformance
from flexmotion.drivers.emulator.lockstep import LockstepBus
from flexmotion.drivers.emulator.loopback import Loopback
from flexmotion.drivers.emulator.sim_body import SimBody
from flexmotion.drivers.interface import Driver, RobotState
from flexmotion.drivers.registry import create
from flexmotion.drivers.sim.driver import SimDriver
from flexmotion.drivers.sim.options import SimOptions

from ..waiting import wait_until
from .bus.robots import looped, op3_with


class TestSim(DriverConformance):
    def make_driver(self) -> Driver:
        return SimDriver(load_robot("op3"), options=SimOptions(suspended=True))


@pytest.mark.wall_clock
class TestDetachedSim(DriverConformance):
    def make_driver(self) -> Driver:
        return SimDriver(load_robot("op3"), options=SimOptions(suspended=True)).detached(realtime=False)

    def wait(self, driver: Driver, seconds: float) -> None:
        """Wait until the robot's clock has passed `seconds`: on a slow machine its process may pause."""
        state = RobotState(driver.robot.n)
        driver.read(state)
        end = state.stamp_ns + round(seconds * 1e9)

        def passed() -> bool:
            driver.read(state)
            return state.stamp_ns >= end

        wait_until(passed, "the robot's process publishes a later state", every_s=0.001)


class TestLockstepBus(DriverConformance):
    def make_driver(self) -> Driver:
        robot = load_robot("op3")
        body = SimBody(robot, SimOptions(suspended=True))
        driver = create("dynamixel", robot, port="main")
        assert isinstance(driver, BusDriver)
        return LockstepBus(driver, Loopback(body), body)


class OnLoopback(DriverConformance):
    """Bus drivers on emulated servos; time passes on the emulated clock."""

    driver: str
    robot: Robot
    world: Loopback

    def make_driver(self) -> Driver:
        driver, self.world = looped(self.driver, self.robot)
        return driver

    def wait(self, driver: Driver, seconds: float) -> None:
        self.world.advance(seconds)


class TestDynamixel(OnLoopback):
    driver = "dynamixel"

    @pytest.fixture(autouse=True)
    def _robot(self) -> None:
        self.robot = load_robot("op3")


class TestDynamixelWithoutCurrent(OnLoopback):
    driver = "dynamixel"

    @pytest.fixture(autouse=True)
    def _robot(self, tmp_path: Path) -> None:
        self.robot = op3_with(tmp_path, servo="2XL430-W250", baud=1_000_000)


class TestDynamixelBoundByCurrent(OnLoopback):
    driver = "dynamixel"

    @pytest.fixture(autouse=True)
    def _robot(self, tmp_path: Path) -> None:
        self.robot = op3_with(tmp_path, servo="XC330-T288", baud=1_000_000, current_bound=True)


class TestFeetech(OnLoopback):
    driver = "feetech"

    @pytest.fixture(autouse=True)
    def _robot(self, tmp_path: Path) -> None:
        self.robot = op3_with(tmp_path, servo="STS3215-12V", baud=1_000_000)


class TestLx16a(OnLoopback):
    driver = "lx16a"

    @pytest.fixture(autouse=True)
    def _robot(self, tmp_path: Path) -> None:
        self.robot = op3_with(tmp_path, servo="LX-16A", baud=115_200)
