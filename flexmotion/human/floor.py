"""Height of the floor under a recorded human."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from flexmotion.human.kinematics import HumanKinematics

Float = NDArray[np.float64]

LOW, SLOW = 0.05, 0.2
"""Greatest height above its lowest [m] and greatest speed [m/s] of a sole point that rests on the floor."""


def clip_floor(human: HumanKinematics, fps: float) -> float:
    """Height of the floor of a whole clip [m]: median height of heels and toe joints that rest on it.

    The median of many low and slow points, not the lowest one: a rigid sole dips under the floor when the foot rolls.
    """
    points = np.concatenate([human.heel, human.toe], axis=1)
    height = points[..., 2]
    speed = np.zeros(height.shape)
    if len(points) > 1:
        speed = np.linalg.norm(np.gradient(points, axis=0), axis=-1) * fps
    lowest = float(np.quantile(height.min(axis=1), 0.1))
    resting = (np.abs(height - lowest) < LOW) & (speed < SLOW)
    return float(np.median(height[resting])) if resting.any() else lowest
