"""`Walker`: the simulated robot that follows joint goals through the loop's own clamp, and what the loop sees of it.

Driver, delay, servo plant, IMU and the count of goals outside the envelope are those of every other run
(`flexmotion.drivers.sim`), attitude and speed are the loop's estimates, and goals are clamped by the loop's
`ServoCommand` with its `FootStrikes`. There is no plan, no balance feedback and no ladder.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from flexmotion.configs.robot import Robot
from flexmotion.drivers.interface import JointCommand, RobotState
from flexmotion.drivers.sim.driver import SimDriver
from flexmotion.drivers.sim.options import SimOptions
from flexmotion.streamer.control.estimator import Estimator
from flexmotion.streamer.control.foot_strikes import FootStrikes
from flexmotion.streamer.control.reference import Reference
from flexmotion.streamer.control.servo_command import ServoCommand

Float = NDArray[np.float64]

_NO_BALANCE = 1.0
"""Frequency of the estimator's pendulum, whose divergent component is not used here [1/s]."""


class Walker:
    """A robot on its feet, torque on, from `open` on.

    Args:
        robot: to simulate.
        options: of the simulation.

    Attributes:
        state: newest measurements, as old as the bus makes them.
        estimator: tilt, its rate and the turn of the torso, as the loop estimates them.
        driver: the simulated robot.
        ticks: that have passed.
    """

    def __init__(self, robot: Robot, options: SimOptions) -> None:
        self.robot = robot
        self.driver = SimDriver(robot, options=options)
        self.state, self._goals = RobotState(robot.n), JointCommand(robot.n)
        self.estimator = Estimator(robot, _NO_BALANCE)
        self._servo = ServoCommand(robot, self.driver.delay_s)
        self._strikes = FootStrikes(robot, self.driver.delay_s)
        self._reference, self._no_torque = Reference(robot.n), np.zeros(robot.n)
        self._reference.balanced = True  # the estimator's speed is that of a robot whose feet stand
        self._dt = 1.0 / robot.rate_hz
        self.ticks = 0

    def open(self) -> None:
        """Stand in the stand pose, with torque on."""
        self.driver.open()
        self.driver.set_torque(True)
        self.driver.read(self.state)
        self.estimator.begin_attitude(self.state.accel)
        self._servo.reset(self.state.position)
        self.ticks = 0

    def read(self, right_share: float = 0.5) -> None:
        """Take the measurements of this tick; once a tick, before `follow`. `right_share`: load on the right foot."""
        self.driver.read(self.state)
        self._reference.share = right_share
        self.estimator.update(self.state, self._reference)
        self._strikes.update(self.estimator)

    def follow(self, q: Float, qd: Float) -> None:
        """Send goals for angles [rad] and speeds [rad/s], (n,) each, inside the envelope, and let a tick pass."""
        self._goals.position[:] = self._servo.update(q, qd, self._no_torque, self.state, struck=self._strikes.change)
        self.driver.write(self._goals)
        self.driver.advance(self._dt)
        self.ticks += 1

    @property
    def clamps(self) -> int:
        """Goals that were clamped in the last tick."""
        return self._servo.torque_clamps + self._servo.position_clamps

    @property
    def fell(self) -> bool:
        """Whether the torso is tilted as a fallen one, by its true attitude."""
        return self.driver.torso_up < np.cos(self.robot.safety.fall_tilt)
