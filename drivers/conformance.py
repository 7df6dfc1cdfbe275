"""What every driver must do, as tests that any driver can run on itself.

A plug-in's test suite subclasses `DriverConformance`, and pytest finds the rest:

    class TestMyDriver(DriverConformance):
        def make_driver(self) -> Driver:
            return MyDriver(load_robot("op3"))
"""

# ruff: noqa: D102 - a test says by its name what it tests
from __future__ import annotations

import math
import time
from abc import ABC, abstractmethod

import numpy as np

from flexmotion.configs.schema import Strict
from flexmotion.drivers.interface import Capabilities, Driver, JointCommand, RobotState

STILL = 0.05
"""A joint that is pinned to where it is moves no further than this [rad]."""


class DriverConformance(ABC):
    """Tests of the interface; the robot must be free to move, or simulated.

    Attributes:
        ticks: that a test runs a driver for.
    """

    ticks = 20

    @abstractmethod
    def make_driver(self) -> Driver:
        """A driver that is not open."""

    def wait(self, driver: Driver, seconds: float) -> None:
        """Let time pass for the robot."""
        if driver.capabilities.lockstep:
            driver.advance(seconds)
        else:
            time.sleep(seconds)

    def run(self, driver: Driver, state: RobotState, command: JointCommand | None = None) -> None:
        """Some ticks; goals are sent where there are any."""
        for _ in range(self.ticks):
            driver.read(state)
            if command is not None:
                driver.write(command)
            self.wait(driver, 1.0 / driver.robot.rate_hz)

    def test_it_says_what_it_is_before_it_is_open(self) -> None:
        driver = self.make_driver()
        assert driver.name and issubclass(driver.Options, Strict)
        assert math.isfinite(driver.delay_s) and driver.delay_s >= 0
        assert isinstance(driver.capabilities, Capabilities)

    def test_it_reads_fresh_values_of_every_joint(self) -> None:
        with self.make_driver() as driver:
            robot, state = driver.robot, RobotState(driver.robot.n)
            self.run(driver, state)
            assert np.isfinite(state.position).all() and np.isfinite(state.velocity).all()
            assert state.stale.max() <= robot.safety.max_stale_reads
            ranges = np.array([servo.range for servo in robot.servos])
            shaft = state.position * robot.direction + robot.zero
            assert (shaft >= ranges[:, 0] - STILL).all() and (shaft <= ranges[:, 1] + STILL).all()

    def test_it_fills_messages_in_place(self) -> None:
        with self.make_driver() as driver:
            state = RobotState(driver.robot.n)
            arrays = {name: value for name, value in vars(state).items() if isinstance(value, np.ndarray)}
            self.run(driver, state)
            assert all(getattr(state, name) is array for name, array in arrays.items())

    def test_stamps_go_forward(self) -> None:
        with self.make_driver() as driver:
            state = RobotState(driver.robot.n)
            self.run(driver, state)
            first = state.stamp_ns
            self.run(driver, state)
            assert state.stamp_ns > first

    def test_it_measures_what_it_claims_to_measure(self) -> None:
        with self.make_driver() as driver:
            state = RobotState(driver.robot.n)
            self.run(driver, state)
            assert driver.capabilities.effort == bool(np.isfinite(state.effort).any())
            if not driver.capabilities.imu:
                assert state.imu_stale == -1
            elif state.imu_stale >= 0:
                assert np.isfinite(state.gyro).all() and np.isfinite(state.accel).all()

    def test_nothing_jumps_when_torque_goes_on(self) -> None:
        with self.make_driver() as driver:
            state, command = RobotState(driver.robot.n), JointCommand(driver.robot.n)
            self.run(driver, state)
            before = state.position.copy()
            driver.set_torque(True)
            command.position[:] = before
            self.run(driver, state, command)
            assert np.abs(state.position - before).max() < STILL
            assert not state.hardware_error.any()

    def test_joints_follow_goals(self) -> None:
        with self.make_driver() as driver:
            robot, state, command = driver.robot, RobotState(driver.robot.n), JointCommand(driver.robot.n)
            self.run(driver, state)
            driver.set_torque(True)
            command.position[:] = state.position
            joint = int(np.argmax(np.minimum(robot.upper - state.position, state.position - robot.lower)))
            goal = state.position[joint] + 0.15
            for _ in range(10):
                command.position[joint] += 0.015
                self.run(driver, state, command)
            assert abs(state.position[joint] - goal) < 2 * STILL

    def test_without_torque_goals_are_ignored(self) -> None:
        with self.make_driver() as driver:
            state, command = RobotState(driver.robot.n), JointCommand(driver.robot.n)
            self.run(driver, state)
            command.position[:] = 0.5 * (driver.robot.lower + driver.robot.upper)
            driver.write(command)
            driver.set_torque(True)
            pinned = state.position.copy()
            driver.read(state)
            assert np.abs(state.position - pinned).max() < STILL

    def test_it_can_be_closed_twice_and_opened_again(self) -> None:
        driver = self.make_driver()
        state = RobotState(driver.robot.n)
        for _ in range(2):
            driver.open()
            self.run(driver, state)
            assert state.stale.max() <= driver.robot.safety.max_stale_reads
            driver.close()
            driver.close()
