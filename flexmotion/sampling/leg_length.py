"""`lowered`: feet moved down or up by stretching or bending the legs, at constant pitch."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from flexmotion.human.motion import Motion
from flexmotion.human.skeleton import JOINTS, SIDES

Float = NDArray[np.float64]

STRAIGHT = np.radians(3.0)
"""Least knee flexion that stretching leads to [rad]."""
MOST_BENT = np.radians(140.0)

HIPS, KNEES, ANKLES = (
    [JOINTS.index(f"{name}_{side}") for side in SIDES] for name in ("hip_flexion", "knee_flexion", "ankle_dorsiflexion")
)
"""Coordinates of left and right leg that turn it in the plane of its knee."""


def lowered(motion: Motion, down: Float, hip: Float, ankle: Float) -> Motion:
    """The motion with its feet lowered by `down`, as far as the legs reach.

    Each ankle moves along the line from its hip, in the plane of the knee; thigh and shank turn by the law of cosines.
    Knees that bend backward are straightened, since a leg could jump between the two solutions.

    Args:
        down: of left and right foot, negative for up, (T, 2) [m].
        hip, ankle: joint centres of the motion, (T, 2, 3) [m].
    """
    thigh, shank = motion.body.segments.thigh, motion.body.segments.shank
    line = hip - ankle
    length = np.linalg.norm(line, axis=-1)
    # An inclined leg stretches by more than the foot is lowered; the bound keeps nearly level legs from stretching far.
    steep = np.maximum(line[..., 2] / np.maximum(length, 1e-6), 0.5)
    knee = motion.joints[:, KNEES]
    own = leg_length(thigh, shank, knee)
    wanted = within_reach(thigh, shank, own, own + down / steep)
    bent = np.where(wanted == own, np.maximum(knee, 0.0), knee_at(thigh, shank, wanted))
    turned = _behind(thigh, shank, bent) - _behind(thigh, shank, knee)
    joints = motion.joints.copy()
    joints[:, KNEES] = bent
    joints[:, HIPS] += turned
    joints[:, ANKLES] += (bent - knee) - turned
    return motion.changed(joints=joints)


def within_reach(thigh: float, shank: float, own: Float, wanted: Float) -> Float:
    """Wanted distances of hip and ankle, no farther than bent and straight legs reach, or are already, (T, 2) [m]."""
    least, most = (leg_length(thigh, shank, bend) for bend in (MOST_BENT, STRAIGHT))
    return np.minimum(np.maximum(wanted, np.minimum(least, own)), np.maximum(most, own))


def knee_at(thigh: float, shank: float, distance: Float) -> Float:
    """Knee angle at a distance of hip and ankle, by the law of cosines [rad]; the inverse of `leg_length`."""
    cosine = (distance**2 - thigh**2 - shank**2) / (2.0 * thigh * shank)
    found: Float = np.arccos(np.minimum(np.maximum(cosine, -1.0), 1.0))
    return found


def leg_length(thigh: float, shank: float, knee: Float | float) -> Float:
    """Distance of hip and ankle at a knee angle [m]."""
    found: Float = np.sqrt(thigh**2 + shank**2 + 2.0 * thigh * shank * np.cos(knee))
    return found


def _behind(thigh: float, shank: float, knee: Float) -> Float:
    """Angle at the hip from the thigh back to the ankle [rad]."""
    found: Float = np.arctan2(shank * np.sin(knee), thigh + shank * np.cos(knee))
    return found
