"""`SoftFollowing`: goals with which joints follow less stiffly than their servos are.

A stiff goal g asks for the torque of the reference and, where the joint is elsewhere, for more: the servo's stiffness
times the error. At a relaxed goal r the servo makes the torque of the reference alone, where the joint is. At
r + share (g - r) it makes that share of what the error would give. Servo, gains and driver stay as they are.

Where the joint is when the goal arrives is predicted from its measurement. With a share s the servo then makes

    tau + s (kp e + b e') + (1 - s) (kp d + b d')

for the error e of the joint and the error d of that prediction: less stiffness and less damping by the same share.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from flexmotion.drivers.masks import some

Float = NDArray[np.float64]
Bool = NDArray[np.bool_]

CHANGE_S = 0.2
"""Time in which the share of a joint may change by 1 [s]: an arm at an obstacle pushes harder by and by."""


class SoftFollowing:
    """Softens goals tick by tick; allocates nothing that grows.

    Args:
        n: number of joints.
        rate_hz: ticks a second.
        turns: ticks within which every joint is read once. Where they are read in turns, joints follow stiffly: what is
            known of them is too old.

    Attributes:
        share: of the servo's stiffness with which each joint follows, (n,) in (0, 1].
        way: from the goals that were sent to the stiff ones, (n,) [rad].
    """

    def __init__(self, n: int, rate_hz: float, turns: int = 1) -> None:
        self.share, self.way = np.ones(n), np.zeros(n)
        self._step, self._knows = 1.0 / (CHANGE_S * rate_hz), turns == 1
        self._stiff, self._next = np.ones(n), np.ones(n)

    def reset(self) -> None:
        """Follow with all of the stiffness from here on."""
        self.share[:], self.way[:] = 1.0, 0.0

    def soften(self, goal: Float, relaxed: Float, asked: Float | None, unsure: Bool) -> None:
        """Soften this tick's goals in place.

        Args:
            goal: stiff goals, (n,) [rad].
            relaxed: goals with which the servos make the torque of the reference where the joints are, (n,) [rad].
            asked: share of the stiffness that is asked for, (n,) in (0, 1]; None: all of it.
            unsure: joints of which it is not known where they are, (n,): they follow with all of it at once.
        """
        share = self.share
        if self._knows:
            np.subtract(self._stiff if asked is None else asked, share, out=self._next)
            np.minimum(np.maximum(self._next, -self._step, out=self._next), self._step, out=self._next)
            share += self._next
            np.minimum(share, 1.0, out=share)
            np.copyto(share, 1.0, where=unsure)
        np.subtract(goal, relaxed, out=self.way)
        self.way *= 1.0 - share
        # A relaxed goal that is no number must not make a stiff one so.
        if some(self.way):
            np.copyto(self.way, 0.0, where=~np.isfinite(self.way))
            goal -= self.way
