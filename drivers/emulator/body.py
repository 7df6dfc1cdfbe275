"""The bodies that emulated servos move.

`BenchBody` is servos on a bench, each with a flywheel: cheap to simulate beside a timed bus.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexmotion.configs.robot import Robot
from flexmotion.drivers.plant import ServoPlant
from flexmotion.drivers.receiver import Receiver
from flexmotion.spatial.gravity import GRAVITY

Float = NDArray[np.float64]
Bool = NDArray[np.bool_]


class Body(ABC):
    """Joints with servos. Arrays are (n,), in robot order.

    Attributes:
        robot: the robot.
        timestep: physics step [s].
        gyro, accel: angular velocity [rad/s] and specific force [m/s²] at an IMU in the torso frame, (3,) each.
    """

    def __init__(self, robot: Robot, timestep: float) -> None:
        self.robot, self.timestep = robot, timestep
        self.gyro, self.accel = np.zeros(3), np.array([0.0, 0.0, GRAVITY])

    @property
    @abstractmethod
    def plant(self) -> ServoPlant:
        """The servos: gains, limits, torque, heat and supply."""

    @property
    @abstractmethod
    def receiver(self) -> Receiver:
        """Takes goals and counts those outside the envelope."""

    @property
    @abstractmethod
    def position(self) -> Float:
        """True joint angles [rad]."""

    @property
    @abstractmethod
    def velocity(self) -> Float:
        """True joint speeds [rad/s]."""

    @abstractmethod
    def receive(self, goal: Float, which: Bool, bound: Float) -> None:
        """Take goals [rad] and torque bounds [N·m, infinite: none] of all servos; those marked in `which` are new."""

    @abstractmethod
    def set_torque(self, which: Bool, on: bool) -> None:
        """Switch the torque of the servos in `which`."""

    @abstractmethod
    def step(self, seconds: float) -> None:
        """Let time pass, in whole physics steps."""

    @abstractmethod
    def block(self, joint: int, on: bool) -> None:
        """Hold a joint mechanically where it is, or let it go."""

    def sense(self) -> None:  # noqa: B027 - on a bench the values never change
        """Update `gyro` and `accel`."""

    def report(self) -> dict[str, Any]:
        """Figures of the body at the end of the emulation."""
        return {"violations": self.receiver.violations}


class BenchBody(Body):
    """Each servo turns a flywheel; gravity is absent."""

    def __init__(self, robot: Robot, *, timestep: float = 0.002, inertia: float = 0.01) -> None:
        """`inertia` of a flywheel [kg·m²], in addition to the servo's own."""
        super().__init__(robot, timestep)
        self._plant, self._receiver = ServoPlant(robot), Receiver(robot)
        self._position, self._velocity = robot.stand_pose.copy(), np.zeros(robot.n)
        self._inertia = inertia + np.array([servo.armature for servo in robot.servos])
        self._friction = np.array([servo.frictionloss for servo in robot.servos])
        self._damping = np.array([servo.damping for servo in robot.servos])
        self._blocked = np.zeros(robot.n, np.bool_)
        self._receiver.pin(self._position)
        self._plant.goal[:] = self._receiver.goal

    @property
    def plant(self) -> ServoPlant:
        """See `Body`."""
        return self._plant

    @property
    def receiver(self) -> Receiver:
        """See `Body`."""
        return self._receiver

    @property
    def position(self) -> Float:
        """See `Body`."""
        return self._position

    @property
    def velocity(self) -> Float:
        """See `Body`."""
        return self._velocity

    def receive(self, goal: Float, which: Bool, bound: Float) -> None:
        """See `Body`."""
        plant = self._plant
        self._receiver.receive(goal, self._position, self._velocity, plant.voltage, plant.enabled, which)
        plant.goal[:] = self._receiver.goal
        plant.torque_bound[:] = bound

    def set_torque(self, which: Bool, on: bool) -> None:
        """See `Body`."""
        self._plant.enabled[which] = on

    def block(self, joint: int, on: bool) -> None:
        """See `Body`."""
        self._blocked[joint] = on

    def step(self, seconds: float) -> None:
        """See `Body`. Semi-implicit Euler; dry friction never reverses a motion."""
        for _ in range(round(seconds / self.timestep)):
            torque = self._plant.step(self._position, self._velocity)
            torque = torque - self._damping * self._velocity
            speed = self._velocity + torque / self._inertia * self.timestep
            drag = self._friction / self._inertia * self.timestep
            self._velocity[:] = np.sign(speed) * np.maximum(np.abs(speed) - drag, 0.0)
            self._velocity[self._blocked] = 0.0
            self._position += self._velocity * self.timestep
        self._plant.draw(self._plant.torque, seconds)
