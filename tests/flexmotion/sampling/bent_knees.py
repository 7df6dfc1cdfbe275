"""Some steps of the default clip with knees that are bent enough to be stretched."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from flexmotion.human.motion import Motion
from flexmotion.human.skeleton import JOINTS, SIDES
from flexmotion.importers.default_clip import default_clip

KNEES = [JOINTS.index(f"knee_flexion_{side}") for side in SIDES]


def bent_walk(least: float) -> Motion:
    """Steps whose knees are bent by this or more [rad]."""
    motion = default_clip()[225:330]
    joints = motion.joints.copy()
    joints[:, KNEES] = np.maximum(joints[:, KNEES], least)
    return replace(motion, joints=joints)
