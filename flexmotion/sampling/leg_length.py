"""`lowered`: feet moved down or up by stretching or bending the legs, at constant pitch."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from flexmotion.compiled import doubles
from flexmotion.human.body import Body
from flexmotion.human.motion import Motion
from flexmotion.human.skeleton import JOINTS, SIDES
from flexmotion.sampling.leg_loops import Leg, stretched

Float = NDArray[np.float64]

STRAIGHT = np.radians(3.0)
"""Least knee flexion that stretching leads to [rad]."""
MOST_BENT = np.radians(140.0)

HIPS, KNEES, ANKLES = (
    [JOINTS.index(f"{name}_{side}") for side in SIDES] for name in ("hip_flexion", "knee_flexion", "ankle_dorsiflexion")
)
"""Coordinates of left and right leg that turn it in the plane of its knee."""
_COLUMNS = tuple(np.array(columns) for columns in (HIPS, KNEES, ANKLES))


def lowered(motion: Motion, down: Float, hip: Float, ankle: Float) -> Motion:
    """The motion with its feet lowered by `down`, as far as the legs reach.

    Each ankle moves along the line from its hip, in the plane of the knee; thigh and shank turn by the law of cosines.
    Knees that bend backward are straightened, since a leg could jump between the two solutions.

    Args:
        down: of left and right foot, negative for up, (T, 2) [m].
        hip, ankle: joint centres of the motion, (T, 2, 3) [m].
    """
    own = doubles
    joints = stretched(lengths(motion.body), own(motion.joints), own(down), own(hip), own(ankle), *_COLUMNS)
    return motion.changed(joints=joints)


def leg_length(thigh: float, shank: float, knee: float) -> float:
    """Distance of hip and ankle at a knee angle [m]."""
    return float(np.sqrt(thigh**2 + shank**2 + 2.0 * thigh * shank * np.cos(knee)))


@lru_cache(maxsize=32)
def lengths(body: Body) -> Leg:
    """Lengths of a human's leg."""
    size = body.segments
    shortest, longest = (leg_length(size.thigh, size.shank, bend) for bend in (MOST_BENT, STRAIGHT))
    return Leg(size.thigh, size.shank, shortest, longest, 0.5 * (size.ball - size.heel), -size.ankle_height)
