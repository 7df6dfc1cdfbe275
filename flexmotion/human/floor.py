"""Height of the floor under a recorded human, and of what a human is on at a moment."""

from __future__ import annotations

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from flexmotion.human.kinematics import HumanKinematics

Float = NDArray[np.float64]

LOW, SLOW = 0.05, 0.2
"""Greatest height above its lowest [m] and greatest speed [m/s] of a sole point that rests on the floor."""
RESTS_S = 0.1
"""A sole point rests that is slow for this long [s]: at the top of a jump it is for a shorter time."""


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


def ground_under(human: HumanKinematics, fps: float) -> float:
    """Height of what a human is on in the last frame [m]: the floor, a step, a ladder.

    This is the lowest point of feet, knees, hands and head now. During a jump it is the height at which a sole last
    rested. Where no sole has rested, it is the lowest point of all frames.
    """
    sole = np.concatenate([human.heel, human.toe], axis=1)
    lowest = np.concatenate([sole, human.knee, human.wrist, human.vertex[:, None]], axis=1)[..., 2].min(axis=1)
    over = max(round(RESTS_S * fps), 1)
    slow = np.linalg.norm(np.diff(sole, axis=0), axis=-1) * fps < SLOW
    rests = np.zeros((len(sole), sole.shape[1]), bool)
    if len(slow) >= over:
        rests[over:] = sliding_window_view(slow, over, axis=0).all(axis=-1)
    if not rests.any():
        return float(lowest.min())
    last = np.flatnonzero(rests.any(axis=1))[-1]
    return float(min(lowest[-1], sole[last, rests[last], 2].min()))
