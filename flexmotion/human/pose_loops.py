"""Compiled loop over poses of the human model: forward kinematics of every frame, as `mj_kinematics` does them."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import types
from numpy.typing import NDArray

from flexmotion.compiled import BOOL, FLOATS, INTS, compiled, fields, part

Float = NDArray[np.float64]
Int = NDArray[np.int64]


class Segments(NamedTuple):
    """Segments of a human model, the world first, each behind the one that carries it.

    Attributes:
        parent: of each of B segments, (B,).
        offset, turn: of each in its parent, (B, 3) [m] and (B, 3, 3).
        centre: of mass, in the segment's axes, (B, 3) [m].
        first, hinged: its first joint, and how many it has, (B,).
        columns: of each of H joints among the coordinates, (H,); -1: the free joint of the root.
        anchor, axis: in the axes of their segments, (H, 3) [m] and unit vectors.
        bearer: segment of each of S sites, (S,).
        sites: in the axes of their segments, (S, 3) [m].
    """

    parent: Int
    offset: Float
    turn: Float
    centre: Float
    first: Int
    hinged: Int
    columns: Int
    anchor: Float
    axis: Float
    bearer: Int
    sites: Float


_SEGMENTS = fields(
    Segments, INTS[1], FLOATS[2], FLOATS[3], FLOATS[2], *[INTS[1]] * 3, *[FLOATS[2]] * 2, INTS[1], FLOATS[2]
)


@part
def _place(turned: Float, b: int, vectors: Float, number: int, origins: Float, origin: int, found: Float) -> None:
    """Write vector `number` turned by rotation `b`, from an origin, in the place of that number."""
    x, y, z = vectors[number, 0], vectors[number, 1], vectors[number, 2]
    for row in range(3):
        along = turned[b, row, 0] * x + turned[b, row, 1] * y + turned[b, row, 2] * z
        found[number, row] = origins[origin, row] + along


@part
def _set(turned: Float, b: int, w: float, x: float, y: float, z: float) -> None:
    """Write the rotation of a quaternion of any length; none for one without length, as MuJoCo does."""
    length = w * w + x * x + y * y + z * z
    scale = 2.0 / length if length > 0.0 else 0.0
    turned[b, 0, 0], turned[b, 1, 1] = 1.0 - scale * (y * y + z * z), 1.0 - scale * (x * x + z * z)
    turned[b, 2, 2] = 1.0 - scale * (x * x + y * y)
    turned[b, 0, 1], turned[b, 1, 0] = scale * (x * y - w * z), scale * (x * y + w * z)
    turned[b, 0, 2], turned[b, 2, 0] = scale * (x * z + w * y), scale * (x * z - w * y)
    turned[b, 1, 2], turned[b, 2, 1] = scale * (y * z - w * x), scale * (y * z + w * x)


@part
def _turn(turned: Float, b: int, x: float, y: float, z: float, angle: float) -> None:
    """Turn a rotation by an angle about an axis of its own frame (Rodrigues)."""
    s, c = math.sin(angle), math.cos(angle)
    d = 1.0 - c
    for row in range(3):
        a, e, f = turned[b, row, 0], turned[b, row, 1], turned[b, row, 2]
        turned[b, row, 0] = a * (c + d * x * x) + e * (d * x * y + s * z) + f * (d * x * z - s * y)
        turned[b, row, 1] = a * (d * x * y - s * z) + e * (c + d * y * y) + f * (d * y * z + s * x)
        turned[b, row, 2] = a * (d * x * z + s * y) + e * (d * y * z - s * x) + f * (c + d * z * z)


@compiled(_SEGMENTS, *[FLOATS[2]] * 3, types.Array(BOOL, 1, "C"))
def poses(
    model: Segments, position: Float, quaternion: Float, joints: Float, needed: NDArray[np.bool_]
) -> tuple[Float, Float, Float, Float, Float, Float]:
    """Poses of the segments in the world.

    Args:
        model: the human.
        position, quaternion: of the root, (T, 3) [m] and (T, 4), w x y z.
        joints: coordinates, (T, J) [rad].
        needed: segments that are needed, with all that carry them, (B,); what belongs to others is not written.

    Returns:
        As MuJoCo's `xpos` (T, B, 3) [m], `xipos` (T, B, 3) [m], `xmat` (T, B, 9), `xanchor` (T, H, 3) [m], `xaxis`
        (T, H, 3) and `site_xpos` (T, S, 3) [m].
    """
    frames, size, number = len(position), len(model.parent), len(model.columns)
    origins, centres = np.zeros((frames, size, 3)), np.zeros((frames, size, 3))
    rotations = np.empty((frames, size, 3, 3))
    anchors, axes = np.empty((frames, number, 3)), np.empty((frames, number, 3))
    sites = np.empty((frames, len(model.bearer), 3))
    offset, centre, anchor, axis = model.offset, model.centre, model.anchor, model.axis
    for t in range(frames):
        turned, origin, middle, pivot, about = rotations[t], origins[t], centres[t], anchors[t], axes[t]
        _set(turned, 0, 1.0, 0.0, 0.0, 0.0)
        for b in range(1, size):
            if not needed[b]:
                continue
            above, first = model.parent[b], model.first[b]
            if model.hinged[b] and model.columns[first] < 0:
                _set(turned, b, quaternion[t, 0], quaternion[t, 1], quaternion[t, 2], quaternion[t, 3])
                for row in range(3):
                    origin[b, row] = pivot[first, row] = position[t, row]
                    about[first, row] = axis[first, row]
            else:
                _place(turned, above, offset, b, origin, above, origin)
                for row in range(3):
                    x, y, z = turned[above, row, 0], turned[above, row, 1], turned[above, row, 2]
                    for column in range(3):
                        turned[b, row, column] = (
                            x * model.turn[b, 0, column] + y * model.turn[b, 1, column] + z * model.turn[b, 2, column]
                        )
                for joint in range(first, first + model.hinged[b]):
                    x, y, z = axis[joint, 0], axis[joint, 1], axis[joint, 2]
                    u, v, w = anchor[joint, 0], anchor[joint, 1], anchor[joint, 2]
                    for row in range(3):
                        a, e, f = turned[b, row, 0], turned[b, row, 1], turned[b, row, 2]
                        about[joint, row] = a * x + e * y + f * z
                        pivot[joint, row] = origin[b, row] + (a * u + e * v + f * w)
                    _turn(turned, b, x, y, z, joints[t, model.columns[joint]])
                    # The joint's anchor stays where it is.
                    for row in range(3):
                        origin[b, row] = pivot[joint, row] - (
                            turned[b, row, 0] * u + turned[b, row, 1] * v + turned[b, row, 2] * w
                        )
            _place(turned, b, centre, b, origin, b, middle)
        for site in range(len(model.bearer)):
            bearer = model.bearer[site]
            if needed[bearer]:
                _place(turned, bearer, model.sites, site, origin, bearer, sites[t])
    return origins, centres, rotations.reshape(frames, size, 9), anchors, axes, sites
