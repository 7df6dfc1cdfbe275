"""`LoadEstimator`: the ratio of the legs' true load to the model's: a heavier battery, weaker gains, a low supply.

Planned torques tau are computed for the robot file's masses and stiffness. If all leg joints sag in proportion to their
load, one factor s is wrong, and the tracking error gives it: kp (q_ref - q) = (s - 1) tau.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from flexmotion.configs.robot import Robot

Float = NDArray[np.float64]

_TIME_CONSTANT_S = 0.8
"""Of the low-pass [s]: several steps long, so that the factor does not follow a single swing."""
_BOUNDS = (0.8, 1.35)
"""Range of the factor. Beyond it the robot file is wrong, or something else than the feet carries the robot."""


class LoadEstimator:
    """Least squares of the legs' tracking error on their planned torque, by one gradient step a tick.

    Attributes:
        factor: for the loop to multiply the planned torque with.
    """

    def __init__(self, robot: Robot) -> None:
        self.legs = np.array([i for side in ("left", "right") for i in robot.chain(f"{side}_leg").values()])
        self.kp = robot.kp[self.legs]
        self.factor = 1.0
        self._rate = 1.0 / (_TIME_CONSTANT_S * robot.rate_hz)
        # About the load at rest: with less load the factor changes more slowly.
        self._least = float(0.1 * robot.usable_torque[self.legs].mean()) ** 2 * len(self.legs)

    def reset(self) -> None:
        """Set the factor back to the model's, 1."""
        self.factor = 1.0

    def update(self, q_ref: Float, q: Float, torque: Float) -> None:
        """One tick: reference and measured joints, planned torque, (n,) each."""
        load = torque[self.legs]
        pull = float(load @ (self.kp * (q_ref[self.legs] - q[self.legs])))
        if not np.isfinite(pull):
            return
        self.factor += self._rate * pull / max(float(load @ load), self._least)
        self.factor = min(max(self.factor, _BOUNDS[0]), _BOUNDS[1])
