"""`Receiver`: takes goals as servos do, and counts those outside the envelope.

Shared by the simulated robot and the emulated bus. It shares no code with the loop's command filter, so that its counts
check the filter independently.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from flexmotion.configs.robot import Robot

Float = NDArray[np.float64]

GOAL_AGE_S = 0.02
"""Longest time from the read of a position to the arrival of the first goal, which starts there [s]."""


class Receiver:
    """Takes goals in whole servo ticks and counts those outside the envelope.

    A goal violates the envelope if, after quantisation and with one tick of tolerance,
    - it is outside the joint's limits and further out than the goal before it. The first goal after torque was off, or
      after goals were pinned, may be as far out as the joint itself, plus its motion in `GOAL_AGE_S`; or
    - it is not a number (such a goal is not taken; the last one stays); or
    - the torque that it implies at the servo's true position and speed, |kp (goal - q) V/Vn - b qd|, is above the
      servo's peak at the present supply, stall torque times V/Vn. (The usable torque of a servo that drives its load
      is lower, and the loop's filter stays below it; a servo that exceeds it briefly is still within its peak.)
    Goals to servos whose torque is off are not counted.

    Attributes:
        goal: last goal taken, quantised, (n,) [rad].
        position_violations, torque_violations: counts, one per joint and goal.
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
        self._ticks, self._slack = np.zeros(robot.n), np.zeros(robot.n)
        self._last = np.clip(self.goal, robot.lower, robot.upper)
        self._lowest, self._highest = np.zeros(robot.n), np.zeros(robot.n)
        self._addressed = np.zeros(robot.n, np.bool_)
        self._first = np.ones(robot.n, np.bool_)  # the next goal is the first since torque was off

    @property
    def violations(self) -> int:
        """Goals outside the envelope."""
        return self.position_violations + self.torque_violations

    def pin(self, position: Float, which: NDArray[np.bool_] | None = None) -> None:
        """Set the goal to the present position, (n,) [rad], of all joints or of those in `which`, (n,)."""
        pinned = self._robot.from_ticks(self._robot.to_ticks(position, out=self._ticks))
        where = np.True_ if which is None else which
        np.copyto(self.goal, pinned, where=where)
        np.copyto(self._last, self.goal, where=where)
        self._first |= where

    def receive(
        self,
        goal: Float,
        position: Float,
        velocity: Float,
        voltage: float,
        enabled: NDArray[np.bool_],
        which: NDArray[np.bool_] | None = None,
    ) -> None:
        """Take goals [rad] at the servos' true `position` [rad], `velocity` [rad/s] and supply [V]; (n,) each.

        Args:
            enabled: servos whose torque is on.
            which: servos that get a new goal; for the others `goal` holds a copy of the last one. None: all.
        """
        robot, bad, addressed = self._robot, self._bad, self._addressed
        addressed.fill(True) if which is None else np.copyto(addressed, which)
        self._first |= ~enabled
        np.isfinite(goal, out=self._finite)
        np.copyto(self._ticks, self.goal)
        np.copyto(self._ticks, goal, where=self._finite)
        robot.from_ticks(robot.to_ticks(self._ticks, out=self._ticks), out=self.goal)

        # Limits are checked before quantisation: the servo's own range would hide a goal far outside.
        self._widen(position, velocity)
        np.less(goal, self._lowest, out=bad)
        bad |= goal > self._highest
        bad |= ~self._finite
        np.copyto(self._last, self.goal, where=~(bad & enabled))
        addressed &= enabled
        bad &= addressed
        self._first &= ~addressed
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
        bad &= addressed
        self.torque_violations += int(np.count_nonzero(bad))

    def _widen(self, position: Float, velocity: Float) -> None:
        """Set the range of goals allowed now: the limits, widened to the last goal, for the first goal to the joint."""
        tick, slack = self._robot.tick_rad, self._slack
        np.abs(velocity, out=slack)
        slack *= GOAL_AGE_S
        slack += tick
        np.subtract(position, slack, out=self._lowest)
        np.add(position, slack, out=self._highest)
        np.copyto(self._lowest, self._lower, where=~self._first)
        np.copyto(self._highest, self._upper, where=~self._first)
        # The last goal is known in whole ticks: every goal that rounds to it counts as equal.
        np.minimum(self._lowest, self._last - 0.5 * tick, out=self._lowest)
        np.maximum(self._highest, self._last + 0.5 * tick, out=self._highest)
        np.minimum(self._lowest, self._lower, out=self._lowest)
        np.maximum(self._highest, self._upper, out=self._highest)
