"""How much more (or less) the robot's legs must push than its model says: a heavier battery, weaker gains, low supply.

The torque profile is computed for the robot file's masses and stiffness. Where the legs sag under it, all in
proportion to their load, one factor is wrong, and it can be read off the tracking error: kp (q_ref - q) = (s - 1) tau.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from flexmotion.configs.robot import Robot

Float = NDArray[np.float64]

_TIME_CONSTANT_S = 0.8
"""Several steps long: the factor must not follow the swing of a single one."""
_BOUNDS = (0.8, 1.35)
"""A fifth less to a third more: beyond that the robot file is wrong, or the feet are not what carries it."""


class LoadEstimator:
    """Least squares of the legs' tracking error on their planned torque, one step of its gradient a tick.

    Attributes:
        factor: what the planned torque is multiplied with.
    """

    def __init__(self, robot: Robot) -> None:
        self.legs = np.array([i for side in ("left", "right") for i in robot.chain(f"{side}_leg").values()])
        self.kp = robot.kp[self.legs]
        self.factor = 1.0
        self._rate = 1.0 / (_TIME_CONSTANT_S * robot.rate_hz)
        # As strong as what the legs carry at rest, so that little load moves the factor little.
        self._least = float(0.1 * robot.usable_torque[self.legs].mean()) ** 2 * len(self.legs)

    def reset(self) -> None:
        """Trust the model again."""
        self.factor = 1.0

    def update(self, q_ref: Float, q: Float, torque: Float) -> None:
        """One tick: reference and measured joints, planned torque, (n,) each."""
        load = torque[self.legs]
        pull = float(load @ (self.kp * (q_ref[self.legs] - q[self.legs])))
        if not np.isfinite(pull):
            return
        self.factor += self._rate * pull / max(float(load @ load), self._least)
        self.factor = min(max(self.factor, _BOUNDS[0]), _BOUNDS[1])
