"""Compiled loops over the points of both soles."""

from __future__ import annotations

import numpy as np
from numba import types
from numpy.typing import NDArray

from flexmotion.compiled import BOOL, FLOAT, FLOATS, INTS, compiled

Float = NDArray[np.float64]
Flags = NDArray[np.bool_]
Int = NDArray[np.int64]

_FLAGS = {rank: types.Array(BOOL, rank, "C") for rank in (2, 3)}


@compiled(FLOATS[3], FLOATS[4], INTS[1], FLOATS[2])
def soles(position: Float, rotation: Float, feet: Int, grid: Float) -> tuple[Float, Float, Float, Float]:
    """Origins, axes, points and heights of soles as of `Soles`.

    Args:
        position, rotation: of the segments, (T, B, 3) [m] and (T, B, 3, 3).
        feet: segments of left and right foot, (2,).
        grid: points of a sole in the axes of its foot, (P, 3) [m].
    """
    frames, count = len(position), len(grid)
    origin, axes = np.empty((frames, 2, 2)), np.empty((frames, 2, 2, 2))
    points, height = np.empty((frames, 2, count, 2)), np.empty((frames, 2, count))
    for t in range(frames):
        for side in range(2):
            b = feet[side]
            for row in range(2):
                x, y, z = rotation[t, b, row, 0], rotation[t, b, row, 1], rotation[t, b, row, 2]
                axes[t, side, row, 0], axes[t, side, row, 1] = x, y
                origin[t, side, row] = position[t, b, row] + grid[0, 2] * z
                for p in range(count):
                    along = grid[p, 0] * x + grid[p, 1] * y + grid[p, 2] * z
                    points[t, side, p, row] = position[t, b, row] + along
            x, y, z = rotation[t, b, 2, 0], rotation[t, b, 2, 1], rotation[t, b, 2, 2]
            for p in range(count):
                height[t, side, p] = position[t, b, 2] + (grid[p, 0] * x + grid[p, 1] * y + grid[p, 2] * z)
    return origin, axes, points, height


@compiled(FLOATS[4], _FLAGS[3], FLOATS[2], FLOAT)
def bounds(points: Float, usable: Flags, outward: Float, nowhere: float) -> Float:
    """Greatest distance of a usable point along every direction, (T, D) [m]; `nowhere` without any.

    Args:
        points: (T, 2, P, 2) [m].
        usable: (T, 2, P).
        outward: directions, (2, D).
        nowhere: [m].
    """
    found = np.full((len(points), outward.shape[1]), nowhere)
    for t in range(len(points)):
        for side in range(2):
            for p in range(points.shape[2]):
                if usable[t, side, p]:
                    x, y = points[t, side, p, 0], points[t, side, p, 1]
                    for k in range(outward.shape[1]):
                        along = x * outward[0, k] + y * outward[1, k]
                        found[t, k] = along if along > found[t, k] else found[t, k]
    return found


@compiled(FLOATS[3], _FLAGS[2], FLOAT)
def usable(height: Float, contacts: Flags, reach: float) -> Flags:
    """Points lower than `reach` [m] of feet in contact, or where there are none, of all feet, (T, 2, P).

    Args:
        height: of the points, (T, 2, P) [m].
        contacts: feet in contact, (T, 2).
        reach: see above.
    """
    found = np.empty(height.shape, np.bool_)
    for t in range(len(height)):
        stands = False
        for side in range(2):
            for p in range(height.shape[2]):
                stands = stands or (contacts[t, side] and height[t, side, p] < reach)
        for side in range(2):
            for p in range(height.shape[2]):
                found[t, side, p] = height[t, side, p] < reach and (contacts[t, side] or not stands)
    return found
