"""`at_rest`: who stands lets trunk, head and arms come to rest."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from flexmotion.human.motion import Motion
from flexmotion.human.skeleton import ARM_JOINTS, JOINTS, SIDES, TRUNK_JOINTS

Float = NDArray[np.float64]

RESTING_S = 0.6
"""Time constant with which they do."""

_ARMS = tuple(f"{joint}_{side}" for side in SIDES for joint in ARM_JOINTS)
_UPPER = [JOINTS.index(name) for name in (*TRUNK_JOINTS, *_ARMS)]


def at_rest(motion: Motion, rest: Float) -> Motion:
    """A motion whose upper body goes over to a pose of rest, beginning as it is.

    A model that learnt standing from what people do between gestures lifts the arms again, window after window.

    Args:
        rest: joint angles, (26,) [rad].
    """
    # Smooth at its begin: neither angle nor speed jumps there.
    passed = np.arange(1, len(motion) + 1)[:, None] / motion.fps / RESTING_S
    share = 1.0 - (1.0 + passed) * np.exp(-passed)
    joints = motion.joints.copy()
    joints[:, _UPPER] += share * (rest[_UPPER] - joints[:, _UPPER])
    return replace(motion, joints=joints)
