"""`at_rest`: trunk, head and arms of a standing human move to a rest pose."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from flexmotion.human.motion import Motion
from flexmotion.human.skeleton import ARM_JOINTS, JOINTS, SIDES, TRUNK_JOINTS

Float = NDArray[np.float64]

RESTING_S = 0.6
"""Time constant of that motion."""

ARMS = [JOINTS.index(f"{joint}_{side}") for side in SIDES for joint in ARM_JOINTS]
_UPPER = [*(JOINTS.index(name) for name in TRUNK_JOINTS), *ARMS]


def at_rest(motion: Motion, rest: Float) -> Motion:
    """The motion with its upper body moved to a rest pose, from where it is.

    Needed because standing is learnt from pauses between gestures: without it the model raises the arms again.

    Args:
        rest: joint angles, (26,) [rad].
    """
    return led_to(motion, rest, _UPPER, RESTING_S)


def led_to(motion: Motion, pose: Float, columns: list[int], seconds: float, first: int = 0) -> Motion:
    """The motion with some joints moved to a pose, from where they are; angles and speeds are continuous.

    Args:
        motion: a window.
        pose: joint angles, (26,) [rad].
        columns: joints that move.
        seconds: time constant.
        first: frame of the window in which they begin to.
    """
    passed = np.maximum(np.arange(1, len(motion) + 1) - first, 0)[:, None] / motion.fps / seconds
    share = 1.0 - (1.0 + passed) * np.exp(-passed)
    joints = motion.joints.copy()
    joints[:, columns] += share * (pose[columns] - joints[:, columns])
    return replace(motion, joints=joints)
