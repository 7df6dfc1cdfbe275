"""`lying_on`: on which side a robot lies, from the tilt of its torso."""

from __future__ import annotations

import math
from typing import Literal

import numpy as np
from numpy.typing import NDArray

Float = NDArray[np.float64]
Lying = Literal["front", "back", "side"]

SIDE_RAD = 0.6
"""Lean of the torso to a side from which on the robot lies on its side [rad]."""


def pitch_and_lean(tilt: Float) -> tuple[float, float]:
    """Pitch about the torso's own y axis, and lean to its side, of a torso in any attitude.

    Args:
        tilt: roll and pitch of the z-y-x order, (2,) [rad], which tells a torso past the vertical by a roll of pi.

    Returns:
        Pitch in (-pi, pi], positive forward: about pi/2 on the front, -pi/2 on the back. Lean in [-pi/2, pi/2] [rad].
    """
    roll, pitch = float(tilt[0]), float(tilt[1])
    # The world's up axis in the torso's frame.
    ahead, left, up = -math.sin(pitch), math.cos(pitch) * math.sin(roll), math.cos(pitch) * math.cos(roll)
    return math.atan2(-ahead, up), math.asin(min(max(left, -1.0), 1.0))


def lying_on(tilt: Float, fall_tilt: float) -> Lying | None:
    """What a robot lies on; None: it does not lie.

    Args:
        tilt: roll and pitch of the torso, (2,) [rad].
        fall_tilt: tilt from which on the robot counts as fallen [rad].
    """
    roll, pitch = float(tilt[0]), float(tilt[1])
    if math.acos(min(max(math.cos(roll) * math.cos(pitch), -1.0), 1.0)) <= fall_tilt:
        return None
    forward, lean = pitch_and_lean(tilt)
    if abs(lean) > SIDE_RAD:
        return "side"
    return "front" if forward > 0.0 else "back"
