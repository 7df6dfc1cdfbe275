"""`KeptPose`: arms that stay where a pose was reached, by what later windows are asked for.

People raise a hand, and lower it half a second later: a model of them does the same, again and again, for as long as
it is asked to. What is held is the pose in which the arms were farthest from where they began.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexmotion.features.constraints import Constraints
from flexmotion.human.motion import Motion
from flexmotion.human.skeleton import ARM_JOINTS, JOINTS, SIDES

Float = NDArray[np.float64]

SHOULDER, ELBOW = ARM_JOINTS[:3], ARM_JOINTS[3:4]
ARMS = [JOINTS.index(f"{joint}_{side}") for side in SIDES for joint in ARM_JOINTS]

KEYFRAMES = 3
"""Frames of a window in which the arms are asked for, evenly apart, the last one included: between them they move as
the model moves them. Raised hands were below the shoulder in 50 to 80 % of 15 s, and with them in 2 to 3 %."""

ARRIVED = 4
"""Arms that are farthest in one of the last frames of what is known are still on their way to the pose."""


@dataclass(frozen=True, eq=False)
class KeptPose:
    """Arms in a pose.

    Attributes:
        joints: angles, (26,) in the order of `skeleton.JOINTS`; those of the arms count [rad].
        frame: of the motion, in which they were there.
    """

    joints: Float
    frame: int

    @classmethod
    def reached(cls, motion: Motion) -> KeptPose | None:
        """The pose that was reached in a motion; None: its arms are still on their way.

        Args:
            motion: from the frame on in which the pose was asked for.
        """
        away = np.linalg.norm(motion.joints[:, ARMS] - motion.joints[0, ARMS], axis=1)
        farthest = int(away.argmax())
        return None if farthest >= len(motion) - ARRIVED else cls(motion.joints[farthest], farthest)

    def asked(self, constraints: Constraints, after: int = -1) -> Constraints:
        """Constraints of a window, with its arms in the pose after a frame of the window."""
        frames = len(constraints.mask)
        keys = [round((key + 1) * frames / KEYFRAMES) - 1 for key in range(KEYFRAMES)]
        keys = [key for key in keys if key > after]
        for side in SIDES:
            shoulder, elbow = ([f"{joint}_{side}" for joint in part] for part in (SHOULDER, ELBOW))
            constraints = constraints.angles(f"shoulder_{side}", keys, self._of(shoulder))
            constraints = constraints.angles(elbow[0], keys, self._of(elbow)[0])
        return constraints

    def _of(self, joints: list[str]) -> Float:
        return self.joints[[JOINTS.index(joint) for joint in joints]]
