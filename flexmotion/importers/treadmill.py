"""Velocity of a treadmill's belt, which is removed from a recording before it is differentiated."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from flexmotion.importers.landmarks import Landmarks

Float = NDArray[np.float64]

STANCE_SHARE = 0.35
"""Share of lowest frames in which a toe joint is certainly in stance: stance is 0.6 of the time in walking, 0.35 in
running."""


def belt_velocity(found: Landmarks) -> Float:
    """Horizontal velocity of the floor under the feet, (2,) [m/s]; zero up to rounding without a belt.

    Median over both feet of the toe joint's velocity in the frames in which it is lowest.
    """
    velocities = []
    for side in "lr":
        toe = found.points[f"toe_{side}"]
        low = toe[:, 2] <= np.quantile(toe[:, 2], STANCE_SHARE)
        velocities.append((np.gradient(toe[:, :2], axis=0) * found.fps)[low])
    middle: Float = np.median(np.concatenate(velocities), axis=0)
    return middle


def without_belt(found: Landmarks, velocity: Float) -> Landmarks:
    """The same over ground: the belt's velocity (2,) [m/s] is removed from every point."""
    away = np.zeros((len(found), 3))
    away[:, :2] = np.arange(len(found))[:, None] / found.fps * velocity
    return replace(found, points={name: point - away for name, point in found.points.items()})
