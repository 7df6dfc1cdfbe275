"""`at_rest`: trunk, head and arms of a standing human that nothing is asked of move to a rest pose, or stay in one."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from flexmotion.human.motion import Motion
from flexmotion.human.skeleton import ARM_JOINTS, JOINTS, SIDES, TRUNK_JOINTS
from flexmotion.sampling.settling import KNOWN, settled, stopped

Float = NDArray[np.float64]

RESTING_S = 0.6
"""Time constant with which they move to the pose."""

NEAR, SLOW = 0.35, 0.6
"""Joints of an arm, the neck or the trunk that are all so near to the pose [rad], and so slow [rad/s], are at rest."""

SETTLING_S = 0.2
"""Time constant with which joints at rest settle: led window by window from what is sampled, hands jerked by 5 m/s³."""

ARMS = [JOINTS.index(f"{joint}_{side}") for side in SIDES for joint in ARM_JOINTS]
_PARTS = (
    *([JOINTS.index(name) for name in TRUNK_JOINTS if name.startswith(part)] for part in ("lumbar", "neck")),
    *([JOINTS.index(f"{joint}_{side}") for joint in ARM_JOINTS] for side in SIDES),
)

UPPER = frozenset(joint for part in _PARTS for joint in part)
"""All joints that can be at rest."""


def at_rest(motion: Motion, past: Motion, rest: Float, idle: Collection[int] = UPPER, *, stays: bool = False) -> Motion:
    """The motion with idle joints moved to a rest pose, from where they are.

    Needed because standing is learnt from pauses between gestures: without it the model raises the arms again.

    Args:
        motion: a window.
        past: the motion before it, at least one frame.
        rest: joint angles, (26,) [rad].
        idle: joints, among `UPPER`.
        stays: whether joints that are near the pose stay where they are: everybody's arms hang in their own way.
    """
    known = past.joints[max(0, len(past) - KNOWN) :]
    rate = (known[-1] - known[max(0, len(known) - 2)]) * motion.fps
    joints = motion.joints.copy()
    for part in _PARTS:
        columns = [joint for joint in part if joint in idle]
        if not columns:
            continue
        off = np.abs(known[-1, columns] - rest[columns])
        if (off > NEAR).any() or (np.abs(rate[columns]) > SLOW).any():
            joints[:, columns] = led_to(motion, rest, columns, RESTING_S).joints[:, columns]
            continue
        own, end = known[:, columns], (len(motion), motion.fps, SETTLING_S)
        joints[:, columns] = stopped(own, *end) if stays else settled(own, rest[columns], *end)
    return replace(motion, joints=joints)


def resting(joints: Float, rest: Float) -> Float:
    """Joint angles whose parts that are not near the rest pose are in it, (26,) [rad]."""
    found = joints.copy()
    for part in _PARTS:
        if (np.abs(joints[part] - rest[part]) > NEAR).any():
            found[part] = rest[part]
    return found


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
