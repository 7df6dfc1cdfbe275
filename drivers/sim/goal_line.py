"""`GoalLine`: goals and torque bounds on their way to the simulated servos."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from flexmotion.configs.robot import Robot
from flexmotion.drivers.delay import DelayLine
from flexmotion.drivers.plant import ServoPlant
from flexmotion.drivers.receiver import Receiver

Float = NDArray[np.float64]

UNBOUND = 1e6
"""Torque bound above every servo's torque [N·m]; finite, because the delay line averages bounds."""


class GoalLine:
    """Goals are quantised and counted against the envelope when they are sent, and take effect after the delay.

    Args:
        goal: in effect at first, (n,) [rad].
        delay_s: from sending to the servos acting [s].

    Attributes:
        receiver: takes goals and counts those outside the envelope.
    """

    def __init__(self, robot: Robot, goal: Float, delay_s: float) -> None:
        self._n = robot.n
        self.receiver = Receiver(robot)
        self._row = np.full(2 * robot.n, UNBOUND)
        self._row[: robot.n] = goal
        self._delay = DelayLine(self._row, delay_s)

    def send(
        self,
        goal: Float,
        bound: Float,
        position: Float,
        velocity: Float,
        plant: ServoPlant,
        which: NDArray[np.bool_] | None = None,
    ) -> None:
        """Send goals [rad] and torque bounds [N·m; NaN, infinite: none], (n,) each; see `Receiver.receive`."""
        self.receiver.receive(goal, position, velocity, plant.voltage, plant.enabled, which)
        row, n = self._row, self._n
        row[:n] = self.receiver.goal
        np.fmin(bound, UNBOUND, out=row[n:])
        self._delay.push(row)

    def pin(self, position: Float) -> None:
        """Put the present positions into effect, (n,) [rad]; goals that are under way are dropped."""
        self.receiver.pin(position)
        self._row[: self._n] = self.receiver.goal
        self._row[self._n :] = UNBOUND
        self._delay.reset(self._row)

    def pin_some(self, position: Float, which: NDArray[np.bool_]) -> None:
        """The same for the joints in `which`, (n,)."""
        self.receiver.pin(position, which)
        joints = np.flatnonzero(which)
        columns = np.concatenate([joints, joints + self._n])
        self._row[columns] = np.append(self.receiver.goal[joints], np.full(len(joints), UNBOUND))
        self._delay.overwrite(columns, self._row[columns])

    def advance(self, seconds: float, plant: ServoPlant) -> None:
        """Let time pass and give the plant the goals and bounds of that time."""
        plant.goal[:] = self._delay.advance(seconds)[: self._n]
        plant.torque_bound[:] = self._delay.value[self._n :]
