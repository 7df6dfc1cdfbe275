"""From reference to servo goal: the torque profile's way into a position servo, and the clamp that bounds it.

A position servo makes kp (goal - q) - b q'. So the goal that makes it give `torque` along the reference is
q_ref + (torque + b q_ref') / kp. The goal may run far ahead of the joint; what must be bounded is the torque that it
implies at the joint's present position and speed, and the goal itself by the joint's limits. Where a joint stands
outside of them when torque goes on, its goals begin there and from then on only go inwards.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from flexmotion.configs.robot import Robot
from flexmotion.drivers.interface import RobotState

Float = NDArray[np.float64]

BRAKING_SHARE = 0.8
"""Share of the stall torque that a goal may imply while the servo brakes; the rest covers what the joint's speed may
change by within the 4 ms between its measurement and the goal's arrival (0.9 let three goals in a million pass). Less
costs balance: of 21 walking clips three fell with .75 and swings of 6.8 m/s², none with .8 and 7 m/s²."""
BRAKING_SPEED = 0.3
"""Joint speed from which it counts as braking in full [rad/s]. A joint near standstill gets the usable torque: one
that a foot's impact throws either way within a tick must not find itself past its envelope."""

_SUPPLY_MARGIN = 0.2
"""How far outside the servo's rated supply a reading is still believed: sag under load, regenerated overvoltage."""

_BLIND_SHARE = 0.5
"""Share of its envelope that a joint keeps while its measurement is old: it is no longer where it is taken to be."""


class ServoCommand:
    """Computes and clamps goals; allocates nothing that grows.

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
        """Begin anew where the joints stand, (n,) [rad]: that is the goal until the first update."""
        np.copyto(self.goal, position)
        self._velocity[:] = 0.0

    def update(self, q: Float, qd: Float, torque: Float, measured: RobotState) -> Float:
        """Goals for a reference (n,) each, given the measured joints; returns `goal`."""
        robot = self.robot
        supply = measured.voltage / robot.nominal_voltage
        # A voltage that no such servo runs at is a reading gone wrong, not a stiffness to invert.
        believed = (supply >= self._least_supply) & (supply <= self._most_supply)
        supply = np.where(believed, supply, 1.0)
        kp = robot.kp * supply
        goal = q + (torque + robot.back_emf * qd) / kp
        # The measurement is a while old and the goal takes a while to arrive: it must be right for the joint as it
        # was measured and as it will be if its speed goes on changing as it did.
        now, change = measured.velocity, measured.velocity - self._velocity
        supply = np.where(measured.stale > 0, _BLIND_SHARE * supply, supply)
        lowest, highest = self._envelope(measured.position, now, kp, supply)
        later = now + change
        lowest_later, highest_later = self._envelope(measured.position + self.delay * (now + later), later, kp, supply)
        lowest, highest = np.maximum(lowest, lowest_later), np.minimum(highest, highest_later)
        bounded = np.maximum(np.minimum(goal, highest), lowest)
        np.copyto(self._velocity, measured.velocity)
        self.torque_clamps = int(np.count_nonzero(bounded != goal))
        # Outside its limits a goal may only follow one that was further out.
        lower, upper = np.minimum(robot.lower, self.goal), np.maximum(robot.upper, self.goal)
        limited = np.minimum(np.maximum(bounded, lower), upper)
        self.position_clamps = int(np.count_nonzero(limited != bounded))
        # What is no number never leaves here: the servo keeps the goal it has.
        np.copyto(self.goal, limited, where=np.isfinite(limited))
        return self.goal

    def _envelope(self, position: Float, velocity: Float, kp: Float, supply: Float) -> tuple[Float, Float]:
        """Lowest and highest goal [rad] whose torque a servo may make at this position and velocity, (n,) each."""
        robot = self.robot
        usable = robot.usable_torque * supply
        more = np.maximum(BRAKING_SHARE * robot.stall_torque * supply - usable, 0.0)
        braking = velocity / BRAKING_SPEED
        upper = usable + more * np.minimum(np.maximum(-braking, 0.0), 1.0)
        lower = -usable - more * np.minimum(np.maximum(braking, 0.0), 1.0)
        drag = robot.back_emf * velocity
        return position + (lower + drag) / kp, position + (upper + drag) / kp
