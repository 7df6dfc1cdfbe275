"""Compiled loop over poses of the human model: forward kinematics of every frame, as `mj_kinematics` does them."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import types
from numpy.typing import NDArray

from flexmotion.compiled import BOOL, FLOATS, INT, compiled, fields, part

Float = NDArray[np.float64]
Int = NDArray[np.int64]


class Segments(NamedTuple):
    """Segments of a human model, the world first, each behind the one that carries it.

    Attributes:
        parent: of each of B segments, (B,).
        offset, turn: of each in its parent, (B, 3) [m] and (B, 3, 3).
        centre: of mass, in the segment's axes, (B, 3) [m].
        first, count: its joints, (B,).
        columns: of each of H joints among the coordinates, (H,); -1: the free joint of the root.
        hinges: anchor, axis in the axes of their segments, (2, H, 3) [m, 1].
        bearer: segment of each of S sites, (S,).
        sites: in the axes of their segments, (S, 3) [m].
    """

    parent: Int
    offset: Float
    turn: Float
    centre: Float
    first: Int
    count: Int
    columns: Int
    hinges: Float
    bearer: Int
    sites: Float


_INTS = types.Array(INT, 1, "C")
_SEGMENTS = fields(Segments, _INTS, FLOATS[2], FLOATS[3], FLOATS[2], _INTS, _INTS, _INTS, FLOATS[3], _INTS, FLOATS[2])


@part
def _placed(rotation: Float, vector: Float, origin: Float, found: Float) -> None:
    """Write a vector (3,) turned by a rotation (3, 3), from an origin (3,)."""
    x, y, z = vector[0], vector[1], vector[2]
    for row in range(3):
        found[row] = origin[row] + (rotation[row, 0] * x + rotation[row, 1] * y + rotation[row, 2] * z)


@part
def _unit_rotation(quaternion: Float, found: Float) -> None:
    """Write the rotation (3, 3) of a quaternion w x y z of any length."""
    w, x, y, z = quaternion[0], quaternion[1], quaternion[2], quaternion[3]
    length = math.sqrt(w * w + x * x + y * y + z * z)
    w, x, y, z = w / length, x / length, y / length, z / length
    found[0, 0], found[0, 1], found[0, 2] = 1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)
    found[1, 0], found[1, 1], found[1, 2] = 2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)
    found[2, 0], found[2, 1], found[2, 2] = 2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)


@part
def _turn(rotation: Float, axis: Float, angle: float) -> None:
    """Turn a rotation (3, 3) by an angle about an axis of its own frame, in place (Rodrigues)."""
    x, y, z = axis[0], axis[1], axis[2]
    s, c = math.sin(angle), math.cos(angle)
    d = 1.0 - c
    for row in range(3):
        a, b, e = rotation[row, 0], rotation[row, 1], rotation[row, 2]
        rotation[row, 0] = a * (c + d * x * x) + b * (d * x * y + s * z) + e * (d * x * z - s * y)
        rotation[row, 1] = a * (d * x * y - s * z) + b * (c + d * y * y) + e * (d * y * z + s * x)
        rotation[row, 2] = a * (d * x * z + s * y) + b * (d * y * z - s * x) + e * (c + d * z * z)


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
    origins, centres = np.empty((frames, size, 3)), np.empty((frames, size, 3))
    rotations = np.empty((frames, size, 9))
    anchors, axes = np.empty((frames, number, 3)), np.empty((frames, number, 3))
    sites = np.empty((frames, len(model.bearer), 3))
    for t in range(frames):
        turned = rotations[t].reshape(size, 3, 3)
        origins[t, 0], centres[t, 0], turned[0] = 0.0, 0.0, np.eye(3)
        for b in range(1, size):
            if not needed[b]:
                continue
            above, own, origin = model.parent[b], turned[b], origins[t, b]
            first = model.first[b]
            if model.count[b] and model.columns[first] < 0:
                _unit_rotation(quaternion[t], own)
                origin[:] = position[t]
                anchors[t, first] = position[t]
                axes[t, first] = model.hinges[1, first]
            else:
                _placed(turned[above], model.offset[b], origins[t, above], origin)
                for row in range(3):
                    for column in range(3):
                        own[row, column] = (
                            turned[above, row, 0] * model.turn[b, 0, column]
                            + turned[above, row, 1] * model.turn[b, 1, column]
                            + turned[above, row, 2] * model.turn[b, 2, column]
                        )
                for joint in range(first, first + model.count[b]):
                    anchor, axis = model.hinges[0, joint], model.hinges[1, joint]
                    _placed(own, anchor, origin, anchors[t, joint])
                    for row in range(3):
                        axes[t, joint, row] = own[row, 0] * axis[0] + own[row, 1] * axis[1] + own[row, 2] * axis[2]
                    _turn(own, axis, joints[t, model.columns[joint]])
                    # The joint's anchor stays where it is.
                    for row in range(3):
                        origin[row] = anchors[t, joint, row] - (
                            own[row, 0] * anchor[0] + own[row, 1] * anchor[1] + own[row, 2] * anchor[2]
                        )
            _placed(own, model.centre[b], origin, centres[t, b])
        for s in range(len(sites[t])):
            bearer = model.bearer[s]
            if needed[bearer]:
                _placed(turned[bearer], model.sites[s], origins[t, bearer], sites[t, s])
    return origins, centres, rotations, anchors, axes, sites
