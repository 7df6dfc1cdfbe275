"""The receiving end of goals: what servos do with them, and an independent count of goals they should not have got.

Shared by the simulated robot and the emulated bus. It shares no code with the loop's command filter: it is the witness
that the filter works.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from configs.robot import Robot

Float = NDArray[np.float64]


class Receiver:
    """Takes goals as servos do, in whole ticks, and counts those outside the envelope.

    A goal violates the envelope where, after quantisation and with one tick of tolerance,
    - it is outside the joint's limits, or not a number (such a goal is not taken; the last one stays), or
    - the torque that it implies at the servo's true position and speed, |kp (goal - q) V/Vn - b qd|, is above the
      servo's peak at the present supply, stall torque times V/Vn. (The usable torque of a servo that drives its load
      is lower, and the loop's filter aims below it; but a servo overdriven for a moment is within its peak.)
    Goals to servos whose torque is off are ignored and not counted.

    Attributes:
        goal: last goal taken, quantised, (n,) [rad].
        position_violations, torque_violations: counts, one a joint and goal.
    """

    def __init__(self, robot: Robot) -> None:
        self._robot = robot
        self.goal = np.zeros(robot.n)
        self.position_violations = 0
        self.torque_violations = 0
        tick = robot.tick_rad
        self._lower, self._upper = robot.lower - tick, robot.upper + tick
        self._tolerance = robot.kp * tick
        self._finite, self._bad = np.zeros(robot.n, np.bool_), np.zeros(robot.n, np.bool_)
        self._torque, self._scratch = np.zeros(robot.n), np.zeros(robot.n)
        self._ticks = np.zeros(robot.n)

    @property
    def violations(self) -> int:
        """Goals outside the envelope."""
        return self.position_violations + self.torque_violations

    def pin(self, position: Float) -> None:
        """Take the present position as the goal, (n,) [rad]."""
        self._robot.from_ticks(self._robot.to_ticks(position, out=self._ticks), out=self.goal)

    def receive(
        self, goal: Float, position: Float, velocity: Float, voltage: float, enabled: NDArray[np.bool_]
    ) -> None:
        """Take goals [rad] at the servos' true `position` [rad], `velocity` [rad/s] and supply [V]; (n,) each."""
        robot, bad = self._robot, self._bad
        np.isfinite(goal, out=self._finite)
        np.copyto(self._ticks, self.goal)
        np.copyto(self._ticks, goal, where=self._finite)
        robot.from_ticks(robot.to_ticks(self._ticks, out=self._ticks), out=self.goal)

        # Limits are held against what was asked for: a servo's own range would hide a goal far outside.
        np.less(goal, self._lower, out=bad)
        bad |= goal > self._upper
        bad |= ~self._finite
        bad &= enabled
        self.position_violations += int(np.count_nonzero(bad))

        # Everything over V/Vn: kp (goal - q) - b qd Vn/V against the stall torque.
        np.divide(robot.nominal_voltage, voltage, out=self._scratch)
        self._scratch *= robot.back_emf
        self._scratch *= velocity
        np.subtract(self.goal, position, out=self._torque)
        self._torque *= robot.kp
        self._torque -= self._scratch
        np.abs(self._torque, out=self._torque)
        self._torque -= self._tolerance
        np.greater(self._torque, robot.stall_torque, out=bad)
        bad &= enabled
        self.torque_violations += int(np.count_nonzero(bad))
