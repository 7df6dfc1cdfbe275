"""Belt of a treadmill, whose speed has to be added to a recording before it is differentiated."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from flexmotion.importers.landmarks import Landmarks

Float = NDArray[np.float64]

STANCE_SHARE = 0.35
"""Lowest share of frames in which a foot's toe joint surely stands: a walker's foot stands for 0.6 of the time, a
runner's for 0.35."""


def belt_velocity(found: Landmarks) -> Float:
    """Horizontal velocity of the floor under the feet, (2,) [m/s]: zero but for rounding where there is no belt.

    Median over both feet of the toe joint's velocity in those frames where it is lowest.
    """
    velocities = []
    for side in "lr":
        toe = found.points[f"toe_{side}"]
        low = toe[:, 2] <= np.quantile(toe[:, 2], STANCE_SHARE)
        velocities.append((np.gradient(toe[:, :2], axis=0) * found.fps)[low])
    middle: Float = np.median(np.concatenate(velocities), axis=0)
    return middle


def without_belt(found: Landmarks, velocity: Float) -> Landmarks:
    """The same as it would look over ground: the belt's velocity (2,) [m/s] taken out of every point."""
    away = np.zeros((len(found), 3))
    away[:, :2] = np.arange(len(found))[:, None] / found.fps * velocity
    return replace(found, points={name: point - away for name, point in found.points.items()})
