"""From reference to servo goal: the torque profile's way into a position servo, and the clamp that bounds it.

A position servo makes kp (goal - q) - b q'. So the goal that makes it give `torque` along the reference is
q_ref + (torque + b q_ref') / kp. The goal may run far ahead of the joint; what must be bounded is the torque that it
implies at the joint's present position and speed, and the goal itself by the joint's limits.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from configs.robot import Robot
from drivers.interface import RobotState

Float = NDArray[np.float64]

PEAK_SHARE = 0.9
"""Share of the stall torque that a goal may imply while the servo brakes; the rest covers what the joint does before
the goal arrives."""


class ServoCommand:
    """Computes and clamps goals; allocates nothing that grows.

    Attributes:
        goal: servo goals, (n,) [rad].
        position_clamps, torque_clamps: how many joints were clamped in the last tick.
    """

    def __init__(self, robot: Robot, delay_s: float) -> None:
        self.robot, self.delay = robot, delay_s
        self.goal = np.zeros(robot.n)
        self.position_clamps = self.torque_clamps = 0

    def update(self, q: Float, qd: Float, torque: Float, measured: RobotState) -> Float:
        """Goals for a reference (n,) each, given the measured joints; returns `goal`."""
        robot = self.robot
        supply = np.where(np.isfinite(measured.voltage), measured.voltage / robot.nominal_voltage, 1.0)
        kp = robot.kp * supply
        np.copyto(self.goal, q + (torque + robot.back_emf * qd) / kp)
        ahead = measured.position + self.delay * measured.velocity
        braking = robot.back_emf * measured.velocity
        implied = kp * (self.goal - ahead) - braking
        limit = PEAK_SHARE * robot.stall_torque * supply
        motoring = np.minimum(robot.usable_torque * supply, limit)
        upper = np.where(measured.velocity > 0, motoring, limit)
        lower = np.where(measured.velocity < 0, -motoring, -limit)
        bounded = np.clip(implied, lower, upper)
        self.torque_clamps = int(np.count_nonzero(np.abs(bounded - implied) > 1e-6))
        self.goal += (bounded - implied) / kp
        inside = np.clip(self.goal, robot.lower, robot.upper)
        self.position_clamps = int(np.count_nonzero(inside != self.goal))
        self.goal[:] = inside
        return self.goal
