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

_ARMS = tuple(f"{joint}_{side}" for side in SIDES for joint in ARM_JOINTS)
_UPPER = [JOINTS.index(name) for name in (*TRUNK_JOINTS, *_ARMS)]


def at_rest(motion: Motion, rest: Float) -> Motion:
    """The motion with its upper body moved to a rest pose, from where it is.

    Needed because standing is learnt from pauses between gestures: without it the model raises the arms again.

    Args:
        rest: joint angles, (26,) [rad].
    """
    # Angle and speed are continuous at the start.
    passed = np.arange(1, len(motion) + 1)[:, None] / motion.fps / RESTING_S
    share = 1.0 - (1.0 + passed) * np.exp(-passed)
    joints = motion.joints.copy()
    joints[:, _UPPER] += share * (rest[_UPPER] - joints[:, _UPPER])
    return replace(motion, joints=joints)
