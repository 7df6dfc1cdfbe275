"""`GetUpMove`: the robot gets up by the key poses of its file, step by step; a step that fails ends it.

The poses are references like those of every other move: the servo command clamps what they imply. Which parts of the
robot the ground carries is not known while it gets up, so the reference has no torque: the servos' stiffness carries
it.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from flexmotion.configs.get_up import MINIMUM_JERK_PEAK, GetUpStep
from flexmotion.configs.robot import Robot
from flexmotion.spatial.transitions import minimum_jerk
from flexmotion.streamer.control.lying import SIDE_RAD, pitch_and_lean
from flexmotion.streamer.control.reference import Reference

Float = NDArray[np.float64]


class GetUpMove:
    """Plays the steps of one side; begins anew with `begin`.

    Attributes:
        done: the last step is over: the robot is upright.
        failed: why it does not get up; None while it may.
    """

    def __init__(self, robot: Robot) -> None:
        self.robot = robot
        self.done = False
        self.failed: str | None = None
        self._steps: tuple[GetUpStep, ...] = ()
        self._number = self._tick = 0
        self._move_ticks = self._hold_ticks = self._wait_ticks = 0
        self._start, self._goal = np.zeros(robot.n), np.zeros(robot.n)

    def begin(self, position: Float, steps: tuple[GetUpStep, ...]) -> None:
        """Begin at a pose, (n,) [rad], with the steps of the side that the robot lies on."""
        self._steps, self.done, self.failed = steps, False, None
        self._goal[:] = position
        self._begin_step(0)

    def _begin_step(self, number: int) -> None:
        step, rate = self._steps[number], self.robot.rate_hz
        self._number, self._tick = number, 0
        self._start[:], self._goal[:] = self._goal, step.q
        seconds = step.seconds
        if number == 0:  # from wherever the limp joints are
            way = float(np.max(np.abs(self._goal - self._start)))
            seconds = max(seconds, MINIMUM_JERK_PEAK * way / (2 * self.robot.safety.soft_start_speed))
        self._move_ticks = max(math.ceil(seconds * rate), 1)
        self._hold_ticks = self._move_ticks + round(step.hold_s * rate)
        self._wait_ticks = self._hold_ticks + round(step.wait_s * rate)

    def step(self, reference: Reference, tilt: Float | None) -> None:
        """Fill `reference` for this tick and advance one tick.

        Args:
            tilt: measured roll and pitch of the torso, (2,) [rad]; None while the IMU is silent: no step ends by it.
        """
        if self._tick >= self._hold_ticks and not self.done:
            self._judge(tilt)
        now, after = minimum_jerk(np.array([self._tick, self._tick + 1]) / self._move_ticks)
        span = self._goal - self._start
        np.copyto(reference.q, self._start + after * span)
        np.copyto(reference.qd, (after - now) * self.robot.rate_hz * span)
        reference.torque[:] = 0.0
        reference.stiffness.fill(1.0)  # what a plan before the fall asked for is over
        reference.balanced = False
        self._tick += 1

    def _judge(self, tilt: Float | None) -> None:
        """Go on with the next step, wait, or give up."""
        step = self._steps[self._number]
        if tilt is None:
            if self._tick >= self._wait_ticks:
                self.failed = f"{self._where(step)} the IMU is silent: it is not known how the robot lies"
            return
        pitch, lean = pitch_and_lean(tilt)
        upright = step.pitch[0] <= pitch <= step.pitch[1] and abs(lean) <= SIDE_RAD
        if upright and self._number + 1 == len(self._steps):
            self.done = True
        elif upright:
            self._begin_step(self._number + 1)
        elif self._tick >= self._wait_ticks:
            self.failed = self._why(step, pitch, lean)

    def _where(self, step: GetUpStep) -> str:
        return f"after step {self._number + 1} of {len(self._steps)} ({step.name})"

    def _why(self, step: GetUpStep, pitch: float, lean: float) -> str:
        where = self._where(step)
        if abs(lean) > SIDE_RAD:
            return f"{where} it leans to its side by {math.degrees(abs(lean)):.0f}°"
        low, high = (math.degrees(bound) for bound in step.pitch)
        return f"{where} the torso is pitched by {math.degrees(pitch):.0f}°, expected {low:.0f}° to {high:.0f}°"
