"""`UnseenFall`: a robot that swayed as its IMU was lost is taken to fall on, as an inverted pendulum does.

Without an IMU a robot walks open loop, and falls are not detected: a walk seldom needs its feedback. One that already
sways does: its plan says that it is upright, and it would fall stiff, in every state that plays a plan. A strike that
brings a robot down may also pull the cable of its IMU. One that is there and not believed may have told of the sway
itself: the loop leaves it out.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from flexmotion.configs.robot import Robot
from flexmotion.spatial.tilt import falls, lean_of, lean_of_angles
from flexmotion.streamer.control.estimator import Estimator, planned_tilt_rate, roll_pitch
from flexmotion.streamer.control.reference import Reference

Float = NDArray[np.float64]

SWAYS = 0.2
"""Tilt out of the planned one, or its divergent component (with its rate beyond the plan's over the pendulum's natural
frequency), from which on a robot sways [rad]. The latter reaches 0.14 in OP3's walks in simulation, 0.17 with standard
perturbations."""


class UnseenFall:
    """Follows the sway, and foretells it without an IMU; allocates nothing that grows.

    Attributes:
        sways: whether the robot swayed when it was measured last: without an IMU it is not known where its feet are,
            and the ground may stop any joint at any time.
    """

    def __init__(self, robot: Robot) -> None:
        self._limit, self._dt = robot.safety.fall_tilt, 1.0 / robot.rate_hz
        self._diverging, self._converging = np.zeros(2), np.zeros(2)  # parts of roll and pitch [rad]
        self.sways = False

    def update(self, estimator: Estimator, planned: Reference, *, measured: bool) -> bool:
        """One tick of a robot that plays a plan.

        Args:
            measured: whether this tick has a sample of the IMU that is believed.

        Returns:
            Whether there is no IMU, and the robot has toppled if it has fallen on.
        """
        diverging, converging = self._diverging, self._converging
        level = np.array(roll_pitch(planned.base[3:]))
        if measured:
            np.subtract(estimator.tilt, level, out=diverging)
            # A robot that bows turns as planned.
            np.subtract(estimator.tilt_rate, planned_tilt_rate(planned, self._dt), out=converging)
            np.divide(converging, estimator.omega, out=converging)
            diverging += converging
            np.multiply(converging, -2.0, out=converging)
            converging += diverging
            self.sways = max(math.hypot(*diverging), 0.5 * math.hypot(*(diverging + converging))) > SWAYS
        if measured or not self.sways:
            return False
        grows = math.exp(estimator.omega * self._dt)
        diverging *= grows
        converging /= grows
        tilt = level + 0.5 * (diverging + converging)
        if estimator.has_imu:
            return False
        return bool(falls(lean_of_angles(*tilt), lean_of(planned.base[3:]), self._limit))
