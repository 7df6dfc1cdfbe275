"""`Restrictions`: what holds whatever the human does: places of feet, torque caps, how stiff limbs follow."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from flexmotion.retarget.foot_goal import FootGoal


@dataclass(frozen=True)
class Restrictions:
    """What holds.

    Attributes:
        planted: feet that stay on the ground where they are, 0 left, 1 right. While there is one no human's step is
            made: a walk needs both.
        caps: greatest torque by column of the joint [N·m], above 0.
        tension: of limbs, in place of the human's, in [0, 1], by their place in
            `flexmotion.biomechanics.tension.LIMBS`.
        placed: where a foot is to be that may move; None: nowhere. No other step is made then, of either foot.
        astride: the feet stay as they have landed: a stop does not put them side by side.
    """

    planted: frozenset[int] = frozenset()
    caps: Mapping[int, float] = field(default_factory=dict)
    tension: Mapping[int, float] = field(default_factory=dict)
    placed: FootGoal | None = None
    astride: bool = False

    def cap(self, joints: int) -> NDArray[np.float64]:
        """Greatest torque of each joint of a robot, (n,) [N·m]; infinite where there is none."""
        found = np.full(joints, np.inf)
        for joint, most in self.caps.items():
            found[joint] = most
        return found


NO_RESTRICTIONS = Restrictions()
