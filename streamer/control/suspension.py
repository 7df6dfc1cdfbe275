"""`Suspension`: whether the robot hangs on a stand, from the load that its legs carry.

A position servo makes the torque kp (goal - q) - b q'. Projected on the torque that the motion requires of the legs
with the feet on the ground, this is about 1. With the feet in the air the joints reach their goals, and it is about 0.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from flexmotion.configs.robot import Robot

Float = NDArray[np.float64]

_TIME_CONSTANT_S = 0.25
"""Of the low-pass [s]: longer than hops and stumbles, which do not count."""
_LIFTED, _LANDED = 0.25, 0.55
"""Share of the load below which the feet count as lifted, and above which they count as back on the ground. Walking
robots, also perturbed ones, were never below 0.63; hanging ones were below 0 from a quarter of a second on."""
_LEAST_LOAD = 0.03
"""Mean leg torque over the usable torque below which the share is not measured."""


class Suspension:
    """Estimates the load on the legs, tick by tick; allocates nothing that grows.

    Attributes:
        hung: whether the feet are in the air.
        carried: share of the robot's load that its legs carry, low-passed.
    """

    def __init__(self, robot: Robot) -> None:
        self.legs = np.array([i for side in ("left", "right") for i in robot.chain(f"{side}_leg").values()])
        self._kp, self._back_emf = robot.kp[self.legs], robot.back_emf[self.legs]
        self._least = float(_LEAST_LOAD * robot.usable_torque[self.legs].mean()) ** 2 * len(self.legs)
        self._smoothing = 1.0 / (_TIME_CONSTANT_S * robot.rate_hz)
        self.reset()

    def reset(self) -> None:
        """Assume that the robot stands on its feet."""
        self.hung, self.carried = False, 1.0

    def update(self, goal: Float, q: Float, qd: Float, torque: Float) -> bool:
        """One tick: the goals in force, measured joints, and the torque of the motion on the ground, (n,) each.

        Returns:
            Whether `hung` has changed.
        """
        legs = self.legs
        load = torque[legs]
        strength = float(load @ load)
        made = float(load @ (self._kp * (goal[legs] - q[legs]) - self._back_emf * qd[legs]))
        if strength < self._least or not np.isfinite(made):
            return False
        # Bounded, since values far from [0, 1] come from motion, not from load.
        self.carried += self._smoothing * (min(max(made / strength, -1.0), 2.0) - self.carried)
        before, self.hung = self.hung, self.carried < (_LANDED if self.hung else _LIFTED)
        return self.hung is not before
