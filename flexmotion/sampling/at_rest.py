"""`at_rest`: trunk, head and arms of a standing human that nothing is asked of move to a rest pose, or stay in one."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np
from numpy.typing import NDArray

from flexmotion.human.motion import Motion
from flexmotion.human.skeleton import ARM_JOINTS, JOINTS, SIDES, TRUNK_JOINTS
from flexmotion.sampling.ball_path import settled_joints
from flexmotion.sampling.settling import KNOWN, stopped

Float = NDArray[np.float64]

RESTING_S = 0.35
"""Time constant with which they move to the pose [s]: a hand that comes down peaks at 1 to 2 m/s."""

NEAR, UPRIGHT, SLOW = 0.35, 0.09, 0.6
"""Joints of an arm that are all so near to the pose [rad] hang, and those of neck or trunk are upright, where they are
slow as well [rad/s]. Everybody's arms hang in their own way; a trunk that leans is on its way: kept within .35 rad of
the pose, robots that nodded after a walk or a bow leaned by 10 to 17° for as long as they did."""

SETTLING_S = 0.2
"""Likewise of joints that are at rest [s]. Led window by window from what is sampled, hands jerked by 5 m/s³."""

ARMS = [JOINTS.index(f"{joint}_{side}") for side in SIDES for joint in ARM_JOINTS]
_PARTS = (
    *(([JOINTS.index(name) for name in TRUNK_JOINTS if name.startswith(part)], UPRIGHT) for part in ("lumbar", "neck")),
    *(([JOINTS.index(f"{joint}_{side}") for joint in ARM_JOINTS], NEAR) for side in SIDES),
)
"""Joints of each part, and how near to the pose they are at rest [rad]."""

UPPER = frozenset(joint for part, _ in _PARTS for joint in part)
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
    joints, end = motion.joints.copy(), (len(motion), motion.fps)
    moving: dict[float, list[int]] = {}  # by their time constant: all at once
    for part, near in _PARTS:
        columns = [joint for joint in part if joint in idle]
        if not columns:
            continue
        off = np.abs(known[-1, columns] - rest[columns])
        hangs = bool((off <= near).all() and (np.abs(rate[columns]) <= SLOW).all())
        if hangs and stays:
            joints[:, columns] = stopped(known[:, columns], *end, SETTLING_S)
        else:
            moving.setdefault(SETTLING_S if hangs else RESTING_S, []).extend(columns)
    for seconds, columns in moving.items():
        joints[:, columns] = settled_joints(known, rest, columns, *end, seconds)[:, columns]
    return motion.changed(joints=joints)


def resting(joints: Float, rest: Float) -> Float:
    """Joint angles whose parts that are not near the rest pose are in it, (26,) [rad]."""
    found = joints.copy()
    for part, near in _PARTS:
        if (np.abs(joints[part] - rest[part]) > near).any():
            found[part] = rest[part]
    return found
