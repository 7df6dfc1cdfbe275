"""Whether the robot hangs on a stand: its legs then make none of the torque that would carry it.

A position servo makes kp (goal - q) - b q' (its goal is ahead of the joint by what it carries). Projected on the torque
that the motion asks of the legs with the feet on the ground this is about 1; with the feet in the air the joints run on
to their goals, and it is about 0.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from flexmotion.configs.robot import Robot

Float = NDArray[np.float64]

_TIME_CONSTANT_S = 0.25
"""Of the low-pass: a hop or a stumble is no stand."""
_LIFTED, _LANDED = 0.25, 0.55
"""Share of the load that the legs carry, below and above which the feet are taken to have left the ground, or to be
back on it. Walking robots, perturbed too, were never below .63; hung up ones below 0 from a quarter second on."""
_LEAST_LOAD = 0.03
"""Mean leg torque over the usable one below which the share says nothing."""


class Suspension:
    """Looks at the legs' torque, tick by tick; allocates nothing that grows.

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
        """Take the robot to stand on its feet."""
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
        # What is far off one way or the other is motion, not load.
        self.carried += self._smoothing * (min(max(made / strength, -1.0), 2.0) - self.carried)
        before, self.hung = self.hung, self.carried < (_LANDED if self.hung else _LIFTED)
        return self.hung is not before
