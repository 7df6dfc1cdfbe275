"""Metrics on motions: foot contact with the floor, and smoothness."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from flexmotion.features.encode import body_points
from flexmotion.human.kinematics import forward
from flexmotion.human.motion import Motion

Float = NDArray[np.float64]

CONTACT_HEIGHT = 0.05
"""Height below which a foot touches the floor [m]."""

SKATING = 0.5
"""Speed above which a touching foot skates [m/s]."""

MEAN_FRAMES = 5
TOLERANCE = 0.005
"""Tolerance of the height of the floor [m]."""


def foot_metrics(motion: Motion) -> dict[str, float]:
    """Skate ratio (OmniControl, ICLR 2024) and skate, float, penetrate in millimetres (PhysDiff, ICCV 2023).

    Heights are those of heels and toes, the lowest points of the skeleton. Motions of one frame have no skate.
    """
    human = forward(motion)
    feet = np.stack([human.heel, human.toe], axis=2).reshape(len(motion), 4, 3)
    height = feet[..., 2]
    speed = np.linalg.norm(np.diff(feet[..., :2], axis=0), axis=-1) * motion.fps
    touching = (height[:-1] < CONTACT_HEIGHT) & (height[1:] < CONTACT_HEIGHT)
    kernel = np.ones(MEAN_FRAMES) / MEAN_FRAMES
    mean = np.stack([np.convolve(column, kernel, mode="same") for column in speed.T], axis=1)
    skating = (touching & (speed > SKATING) & (mean > SKATING)).any(axis=1)
    lowest = height.argmin(axis=1)
    frames = np.arange(len(motion) - 1)
    low = height.min(axis=1)
    down = (low[:-1] <= TOLERANCE) & (low[1:] <= TOLERANCE)
    slide = speed[frames, lowest[:-1]] / motion.fps
    return {
        "skate_ratio": float(skating.mean()) if len(frames) else 0.0,
        "skate_mm": 1e3 * float(slide[down].mean()) if down.any() else 0.0,
        "float_mm": 1e3 * float(np.maximum(0.0, low - TOLERANCE).mean()),
        "penetrate_mm": 1e3 * float(np.maximum(0.0, -(low + TOLERANCE)).mean()),
    }


def jerk(motion: Motion) -> Float:
    """Mean jerk of the points of `layout.POINTS` at every third difference, (T - 3,) [m/s³]."""
    third = np.diff(body_points(forward(motion)), n=3, axis=0) * motion.fps**3
    magnitude: Float = np.linalg.norm(third, axis=-1).mean(axis=1)
    return magnitude
