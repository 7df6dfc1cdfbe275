"""`Soles`: where the ground can act on the feet of a motion, frame by frame, in closed form."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from flexmotion.biomechanics.segment_motion import SegmentMotion
from flexmotion.biomechanics.sole import sole_grid
from flexmotion.human.body import Body
from flexmotion.human.human_model import human_model
from flexmotion.human.skeleton import SIDES
from flexmotion.sampling.sole_loops import bounds, soles, usable

Float = NDArray[np.float64]
Flags = NDArray[np.bool_]

DIRECTIONS = 32
"""Directions in which the region under the soles is bounded: a polygon that exceeds it by .5 % of a distance."""

_ANGLES = 2.0 * np.pi * np.arange(DIRECTIONS) / DIRECTIONS
OUTWARD = np.stack([np.cos(_ANGLES), np.sin(_ANGLES)])
"""Unit vectors of those directions, (2, 32)."""

NOWHERE = -1e3
"""Bound of a region without points [m]."""


@dataclass(frozen=True)
class Soles:
    """Soles of left and right foot over a floor at z = 0.

    The point x, y of a sole, x from the heel to the toes, is at `origin + axes @ (x, y)` on the floor.

    Attributes:
        origin: point of the floor below the sole's origin, (T, 2, 2) [m].
        axes: x and y of the sole on the floor as columns, shortened by its tilt, (T, 2, 2, 2).
        lattice: coordinates of the points of a sole, (12, 2) [m].
        points: those points on the floor, (T, 2, 12, 2) [m].
        height: of the points, (T, 2, 12) [m].
    """

    origin: Float
    axes: Float
    lattice: Float
    points: Float
    height: Float

    @classmethod
    def of(cls, body: Body, segments: SegmentMotion) -> Soles:
        """Soles of a motion."""
        feet, grid, lattice = _shape(body)
        origin, axes, points, height = soles(
            np.ascontiguousarray(segments.position), np.ascontiguousarray(segments.rotation), feet, grid
        )
        return cls(origin, axes, lattice, points, height)

    def __getitem__(self, frames: slice) -> Soles:
        """The soles of some frames."""
        return Soles(self.origin[frames], self.axes[frames], self.lattice, self.points[frames], self.height[frames])

    def moved(self, shift: Float) -> Soles:
        """The soles of a body that is shifted as a whole, by (T, 3) [m]."""
        away = shift[:, None, :2]
        return replace(
            self,
            origin=self.origin + away,
            points=self.points + away[:, :, None],
            height=self.height + shift[:, None, None, 2],
        )

    def bounds(self, usable: Flags) -> Float:
        """Greatest distance of a usable point along every direction of `OUTWARD`, (T, 32) [m].

        Args:
            usable: whether the ground can act at a point, (T, 2, 12).
        """
        return bounds(np.ascontiguousarray(self.points), np.ascontiguousarray(usable), OUTWARD, NOWHERE)

    def usable(self, contacts: Flags, reach: float) -> Flags:
        """Points lower than `reach` of feet in contact, or where there are none, of all feet, (T, 2, 12).

        Args:
            contacts: feet in contact, (T, 2).
            reach: [m].
        """
        return usable(np.ascontiguousarray(self.height), np.ascontiguousarray(contacts), reach)


@lru_cache(maxsize=32)
def _shape(body: Body) -> tuple[NDArray[np.int64], Float, Float]:
    """Segments of left and right foot, (2,), points of a sole, (12, 3) [m], and these without their height."""
    index, grid = human_model(body).body_index, np.ascontiguousarray(sole_grid(body), np.float64)
    return np.array([index[f"calcaneus_{side}"] for side in SIDES]), grid, np.ascontiguousarray(grid[:, :2])
