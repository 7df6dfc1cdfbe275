"""`KeptPose`: arms and head that stay in a pose, however the model goes on.

People raise a hand, and lower it half a second later: a model of them does the same, again and again, for as long as
it is asked to. What is kept is the pose in which the arms were farthest from where they began (`reached`), or that of
the recipe from which the model's training clips were made (`made_pose.py`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from flexmotion.human.motion import Motion
from flexmotion.sampling.at_rest import ARMS
from flexmotion.sampling.ball_path import led_joints, settled_joints
from flexmotion.sampling.settling import KNOWN
from flexmotion.spatial.transitions import decaying

Float = NDArray[np.float64]

ARRIVED = 4
"""Arms that are farthest in one of the last frames of what is known are still on their way to the pose."""

KEEPING_S = 0.1
"""Time constant with which arms that leave the pose in the window that reaches it are led back [s]: they leave it from
rest, by centimetres."""

SETTLING_S = 0.3
"""Likewise of windows after it, which begin where the one before ended [s]."""

BEFORE = -1
"""Frame of a pose that is asked from the first frame of a window on."""


@dataclass(frozen=True, eq=False)
class KeptPose:
    """A pose.

    Attributes:
        joints: angles, (26,) in the order of `skeleton.JOINTS` [rad].
        frame: after which they are led there, of the motion or of the window that is asked for; before a window
            negative.
        columns: joints that count.
        seconds: time constant with which windows after it come to rest there [s].
    """

    joints: Float
    frame: int
    columns: tuple[int, ...] = tuple(ARMS)
    seconds: float = SETTLING_S

    @classmethod
    def reached(cls, motion: Motion, columns: Sequence[int] = ARMS) -> KeptPose | None:
        """The pose that was reached in a motion; None: its arms are still on their way.

        Args:
            motion: from the frame on in which the pose was asked for.
            columns: joints of the arms that are asked for it.
        """
        away = np.linalg.norm(motion.joints[:, columns] - motion.joints[0, columns], axis=1)
        farthest = int(away.argmax())
        return None if farthest >= len(motion) - ARRIVED else cls(motion.joints[farthest], farthest, tuple(columns))

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
        known = before.joints[max(0, len(before) - KNOWN) :]
        if self.frame >= 0:
            passed = np.maximum(np.arange(len(window)) - self.frame, 0)[:, None] / window.fps
            share = 1.0 - decaying(np.ones(1), np.zeros(1), 1.0 / KEEPING_S, passed)
            return window.changed(joints=led_joints(window.joints, self.joints, columns, share, known[-1]))
        joints = window.joints.copy()
        found = settled_joints(known, self.joints, columns, len(window), window.fps, self.seconds)
        joints[:, columns] = found[:, columns]
        return window.changed(joints=joints)
