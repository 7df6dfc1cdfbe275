"""Tests that every driver must pass.

A plug-in's test suite subclasses `DriverConformance`, and pytest collects the tests:

    class TestMyDriver(DriverConformance):
        def make_driver(self) -> Driver:
            return MyDriver(load_robot("op3"))
"""

# ruff: noqa: D102 - the names of tests say what they check
from __future__ import annotations

import math
import time
from abc import ABC, abstractmethod

import numpy as np

from flexmotion.configs.schema import Strict
from flexmotion.drivers.interface import Capabilities, Driver, JointCommand, RobotState
from flexmotion.drivers.simulated import LockstepDriver, SimulatedDriver, lockstep, simulated

STILL = 0.05
"""Largest motion of a joint whose goal is pinned [rad]."""


class DriverConformance(ABC):
    """Tests of the interface. The robot must be free to move, or simulated.

    Attributes:
        ticks: ticks that a test runs a driver for.
    """

    ticks = 20

    @abstractmethod
    def make_driver(self) -> Driver:
        """Return a driver that is not open."""

    def wait(self, driver: Driver, seconds: float) -> None:
        """Let time pass for the robot."""
        stepped = lockstep(driver)
        if stepped is None:
            time.sleep(seconds)
        else:
            stepped.advance(seconds)

    def run(self, driver: Driver, state: RobotState, command: JointCommand | None = None) -> None:
        """Run `ticks` ticks; `command` is sent in each if given."""
        for _ in range(self.ticks):
            driver.read(state)
            if command is not None:
                driver.write(command)
            self.wait(driver, 1.0 / driver.robot.rate_hz)

    def test_it_describes_itself_before_it_is_open(self) -> None:
        driver = self.make_driver()
        assert driver.name and issubclass(driver.Options, Strict)
        assert math.isfinite(driver.delay_s) and driver.delay_s >= 0
        assert isinstance(driver.capabilities, Capabilities)

    def test_capabilities_of_simulation_match_the_type(self) -> None:
        driver = self.make_driver()
        assert driver.capabilities.truth == isinstance(driver, SimulatedDriver)
        assert driver.capabilities.lockstep == isinstance(driver, LockstepDriver)

    def test_a_simulated_robot_reports_its_true_state(self) -> None:
        with self.make_driver() as driver:
            robot = simulated(driver)
            if robot is None:
                return
            n, state = driver.robot.n, RobotState(driver.robot.n)
            self.run(driver, state)
            truth = robot.truth()
            shapes = {
                **dict.fromkeys(("joint_position", "torque", "saturated"), (n,)),
                **dict.fromkeys(("foot_position", "foot_velocity", "foot_force"), (2, 3)),
                **{"base_position": (3,), "base_quaternion": (4,), "com": (3,)},
            }
            for name, shape in shapes.items():
                values = getattr(truth, name)
                assert values.shape == shape and np.isfinite(values).all(), name
            assert math.isclose(float(np.linalg.norm(truth.base_quaternion)), 1.0, abs_tol=1e-6)
            assert isinstance(truth.self_contact, bool)

    def test_time_in_lockstep_passes_only_in_advance(self) -> None:
        with self.make_driver() as driver:
            stepped = lockstep(driver)
            if stepped is None:
                return
            state, period = RobotState(driver.robot.n), 1.0 / driver.robot.rate_hz
            self.run(driver, state)
            before = stepped.truth().joint_position.copy()
            time.sleep(period)
            assert (stepped.truth().joint_position == before).all()
            driver.read(state)
            first = state.stamp_ns
            stepped.advance(period)
            driver.read(state)
            assert math.isclose((state.stamp_ns - first) * 1e-9, period, abs_tol=0.5 * period)

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

    def test_stamps_increase(self) -> None:
        with self.make_driver() as driver:
            state = RobotState(driver.robot.n)
            self.run(driver, state)
            first = state.stamp_ns
            self.run(driver, state)
            assert state.stamp_ns > first

    def test_it_measures_what_its_capabilities_promise(self) -> None:
        with self.make_driver() as driver:
            state = RobotState(driver.robot.n)
            self.run(driver, state)
            assert driver.capabilities.effort == bool(np.isfinite(state.effort).any())
            if not driver.capabilities.imu:
                assert state.imu_stale == -1
            elif state.imu_stale >= 0:
                assert np.isfinite(state.gyro).all() and np.isfinite(state.accel).all()

    def test_joints_stay_when_torque_goes_on(self) -> None:
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

    def test_a_single_joint_goes_limp_and_is_stiff_again_where_it_is(self) -> None:
        with self.make_driver() as driver:
            robot, state, command = driver.robot, RobotState(driver.robot.n), JointCommand(driver.robot.n)
            if not driver.capabilities.joint_torque:
                return
            self.run(driver, state)
            driver.set_torque(True)
            command.position[:] = state.position
            self.run(driver, state, command)
            driver.take_pins(np.zeros(robot.n))
            which = np.arange(robot.n) == 0
            driver.switch(which, False)
            held = state.position.copy()
            away = float(np.sign(robot.upper[0] + robot.lower[0] - 2 * held[0])) or 1.0
            command.position[0] = held[0] + 0.15 * away
            self.run(driver, state, command)
            assert np.abs(state.position - held)[1:].max() < STILL, "the others hold"
            assert (state.position[0] - held[0]) * away < 0.1, "it follows no goals"
            before = state.position[0]
            command.position[0] = before
            self.run(driver, state, command)
            driver.switch(which, True)
            self.run(driver, state, command)
            assert abs(state.position[0] - before) < STILL and not state.hardware_error.any()
            pins = np.full(robot.n, np.nan)
            driver.take_pins(pins)
            assert np.isnan(pins[1:]).all(), "no other joint was pinned"

    def test_goals_are_ignored_without_torque(self) -> None:
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
