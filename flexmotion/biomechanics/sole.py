"""Points of the sole at which the ground may act, and their nearness to stance."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d

from flexmotion.biomechanics.differentiation import derivative
from flexmotion.biomechanics.segment_motion import SegmentMotion
from flexmotion.human.body import Body
from flexmotion.human.human_model import human_model
from flexmotion.human.skeleton import SIDES

Float = NDArray[np.float64]

BREADTH = 0.055
"""Width of the foot as a share of stature (Drillis & Contini 1966)."""

ROWS, COLUMNS = 4, 3
POINTS = ROWS * COLUMNS
"""Points per foot: four from heel to toe tip, three across."""

REACH = 0.05
"""Greatest height of a point at which the ground acts [m]."""


@dataclass(frozen=True)
class SolePoints:
    """Sole points of left and right foot, (T, 2, 12, ...), heel first.

    Attributes:
        position: on the floor below the point, (T, 2, 12, 3) [m].
        nearness: 1 for a point that rests on the floor for some time, decreasing to 0 with height and speed,
            (T, 2, 12).
    """

    position: Float
    nearness: Float


@dataclass(frozen=True)
class Nearness:
    """Nearness of a point is a Gaussian of its height and speed, times its own average over time.

    The average follows the load from heel to toe: a heel that rests while the toe comes down carries more than the toe,
    and a toe that stays while the heel leaves carries more than the heel. Height and speed are soft, so that a single
    foot near the floor carries the load at any speed.

    Attributes:
        height: width, the error of joint centres and fitted soles [m].
        speed: width, the speed of a heel at a low-passed strike [m/s].
        spell: standard deviation of the average, the time in which load passes along the sole [s].
        impact: a point with a greater vertical speed is in the air as soon as it is above `height` [m/s].
    """

    height: float = 0.02
    speed: float = 0.5
    spell: float = 0.1
    impact: float = 1.5


NEARNESS = Nearness()


@lru_cache(maxsize=32)
def sole_grid(body: Body) -> Float:
    """Sole points in the frame of the calcaneus, the same for both feet, (12, 3) [m]; one array a body, read-only."""
    size = body.segments
    along = np.linspace(-size.heel, size.foot - size.heel, ROWS)
    across = np.linspace(-0.5, 0.5, COLUMNS) * BREADTH * body.height
    x, y = np.meshgrid(along, across, indexing="ij")
    grid = np.stack([x.ravel(), y.ravel(), np.full(POINTS, -size.ankle_height)], axis=-1)
    grid.flags.writeable = False
    return grid


def sole_points(body: Body, segments: SegmentMotion, fps: float, limits: Nearness = NEARNESS) -> SolePoints:
    """Sole points of a motion over a floor at z = 0."""
    index = human_model(body).body_index
    feet = [index[f"calcaneus_{side}"] for side in SIDES]
    position = segments.position[:, feet, None] + np.einsum(
        "tsij,pj->tspi", segments.rotation[:, feet], sole_grid(body)
    )
    velocity = derivative(position, fps)
    speed = np.linalg.norm(velocity, axis=-1)
    height = np.maximum(position[..., 2], 0.0)
    reach = np.where(np.abs(velocity[..., 2]) > limits.impact, limits.height, REACH)
    nearness = np.exp(-((height / limits.height) ** 2) - (speed / limits.speed) ** 2) * (height < reach)
    nearness *= gaussian_filter1d(nearness, limits.spell * fps, axis=0, mode="nearest")
    position[..., 2] = 0.0
    return SolePoints(position, nearness)
