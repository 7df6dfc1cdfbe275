"""`KeptPose`: arms and head that stay in a pose, however the model goes on.

People raise a hand, and lower it half a second later: a model of them does the same, again and again, for as long as
it is asked to. What is kept is the pose in which the arms were farthest from where they began (`reached`), or that of
the recipe from which the model's training clips were made (`made_pose.py`).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from flexmotion.human.motion import Motion
from flexmotion.sampling.at_rest import ARMS, led_to
from flexmotion.sampling.settling import KNOWN, settled

Float = NDArray[np.float64]

ARRIVED = 4
"""Arms that are farthest in one of the last frames of what is known are still on their way to the pose."""

KEEPING_S = 0.1
"""Time constant with which arms that leave the pose in the window that reaches it are led back [s]: they leave it from
rest, by centimetres."""

SETTLING_S = 0.3
"""Likewise of windows after it, which begin where the one before ended [s], and of a pose that is led to."""


@dataclass(frozen=True, eq=False)
class KeptPose:
    """A pose.

    Attributes:
        joints: angles, (26,) in the order of `skeleton.JOINTS` [rad].
        frame: after which they are led there, of the motion or of the window that is asked for; before a window
            negative.
        columns: joints that count.
        seconds: time constant with which a window is led there that begins before `frame` [s].
    """

    joints: Float
    frame: int
    columns: tuple[int, ...] = tuple(ARMS)
    seconds: float = KEEPING_S

    @classmethod
    def reached(cls, motion: Motion) -> KeptPose | None:
        """The pose that was reached in a motion; None: its arms are still on their way.

        Args:
            motion: from the frame on in which the pose was asked for.
        """
        away = np.linalg.norm(motion.joints[:, ARMS] - motion.joints[0, ARMS], axis=1)
        farthest = int(away.argmax())
        return None if farthest >= len(motion) - ARRIVED else cls(motion.joints[farthest], farthest)

    def later(self, frames: int) -> KeptPose:
        """The pose as seen from so many frames later."""
        return replace(self, frame=self.frame - frames)

    def kept(self, window: Motion, before: Motion) -> Motion:
        """A window that is led to the pose after its frame, or where that is before it, comes to rest in the pose.

        Args:
            window: as sampled.
            before: the motion before it, at least one frame.
        """
        columns = list(self.columns)
        known = before.joints[max(0, len(before) - KNOWN) :, columns]
        turns = 2 * np.pi * np.round((known[-1] - self.joints[columns]) / (2 * np.pi))
        pose = self.joints.copy()
        pose[columns] += turns  # an arm that has turned all round goes on where it is
        if self.frame >= 0:
            return led_to(window, pose, columns, self.seconds, self.frame + 1)
        joints = window.joints.copy()
        joints[:, columns] = settled(known, pose[columns], len(window), window.fps, SETTLING_S)
        return replace(window, joints=joints)
