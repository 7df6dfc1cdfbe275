"""`ServoCommand`: servo goals from a reference with its torque, and the clamp that bounds them.

A position servo makes the torque kp (goal - q) - b q'. The goal at which it makes `torque` on the reference is
therefore q_ref + (torque + b q_ref') / kp. The goal may be far ahead of the joint. Two things are bounded: the torque
that the goal implies at the joint's present position and speed, and the goal itself by the joint's limits. If a joint
is outside its limits when torque is switched on, its goals begin there and from then on only move inwards.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from flexmotion.configs.robot import Robot
from flexmotion.drivers.interface import RobotState

Float = NDArray[np.float64]

BRAKING_SHARE = 0.8
"""Share of the stall torque that a goal may imply while the servo brakes. The rest covers the change of the joint's
speed in the 4 ms between its measurement and the goal's arrival (with 0.9 three goals in a million were outside the
envelope). Less costs balance: of 21 walking clips three fell with 0.75 and swings of 6.8 m/s², none with 0.8 and 7
m/s²."""
BRAKING_SPEED = 0.3
"""Joint speed from which the braking torque is allowed in full [rad/s]. Near standstill only the usable torque is: a
foot's impact may reverse the joint within a tick, and the goal must then still be inside the envelope."""

_SUPPLY_MARGIN = 0.2
"""Margin around the servo's rated supply within which a reading is valid, as a share: sag under load, overvoltage."""

_BLIND_SHARE = 0.5
"""Share of the envelope that is used while the joint's measurement is old, since its position is then uncertain."""


class ServoCommand:
    """Computes and clamps goals; allocates nothing that grows.

    Args:
        delay_s: from a measurement to the arrival of the goals computed from it [s].

    Attributes:
        goal: servo goals, (n,) [rad].
        position_clamps, torque_clamps: how many joints were clamped in the last tick.
    """

    def __init__(self, robot: Robot, delay_s: float) -> None:
        self.robot, self.delay = robot, delay_s
        self.goal = np.clip(np.zeros(robot.n), robot.lower, robot.upper)
        self.position_clamps = self.torque_clamps = 0
        self._velocity = np.zeros(robot.n)
        nominal = robot.nominal_voltage
        self._least_supply = np.array([servo.min_voltage for servo in robot.servos]) / nominal * (1 - _SUPPLY_MARGIN)
        self._most_supply = np.array([servo.max_voltage for servo in robot.servos]) / nominal * (1 + _SUPPLY_MARGIN)

    def reset(self, position: Float) -> None:
        """Begin at the joints' positions, (n,) [rad], which are the goals until the first update."""
        np.copyto(self.goal, position)
        self._velocity[:] = 0.0

    def update(self, q: Float, qd: Float, torque: Float, measured: RobotState) -> Float:
        """Goals for a reference.

        Args:
            q, qd, torque: the reference, (n,) each [rad, rad/s, N·m].
            measured: the joints' state.

        Returns:
            `goal`, (n,) [rad].
        """
        robot = self.robot
        supply = measured.voltage / robot.nominal_voltage
        # A voltage that no such servo runs at is a wrong reading; the nominal one is used instead.
        believed = (supply >= self._least_supply) & (supply <= self._most_supply)
        supply = np.where(believed, supply, 1.0)
        kp = robot.kp * supply
        goal = q + (torque + robot.back_emf * qd) / kp
        # The measurement is old and the goal takes time to arrive: it must be inside the envelope for the joint as it
        # was measured, and as it will be if its speed changes on at the same rate.
        now, change = measured.velocity, measured.velocity - self._velocity
        supply = np.where(measured.stale > 0, _BLIND_SHARE * supply, supply)
        lowest, highest = self._envelope(measured.position, now, kp, supply)
        later = now + change
        lowest_later, highest_later = self._envelope(measured.position + self.delay * (now + later), later, kp, supply)
        lowest, highest = np.maximum(lowest, lowest_later), np.minimum(highest, highest_later)
        bounded = np.maximum(np.minimum(goal, highest), lowest)
        np.copyto(self._velocity, measured.velocity)
        self.torque_clamps = int(np.count_nonzero(bounded != goal))
        # Outside its limits a goal may only move inwards.
        lower, upper = np.minimum(robot.lower, self.goal), np.maximum(robot.upper, self.goal)
        limited = np.minimum(np.maximum(bounded, lower), upper)
        self.position_clamps = int(np.count_nonzero(limited != bounded))
        # A goal that is not finite is not sent: the servo keeps the goal that it has.
        np.copyto(self.goal, limited, where=np.isfinite(limited))
        return self.goal

    def _envelope(self, position: Float, velocity: Float, kp: Float, supply: Float) -> tuple[Float, Float]:
        """Lowest and highest goal whose torque a servo may make at this position and velocity, (n,) each [rad]."""
        robot = self.robot
        usable = robot.usable_torque * supply
        more = np.maximum(BRAKING_SHARE * robot.stall_torque * supply - usable, 0.0)
        braking = velocity / BRAKING_SPEED
        upper = usable + more * np.minimum(np.maximum(-braking, 0.0), 1.0)
        lower = -usable - more * np.minimum(np.maximum(braking, 0.0), 1.0)
        drag = robot.back_emf * velocity
        return position + (lower + drag) / kp, position + (upper + drag) / kp
