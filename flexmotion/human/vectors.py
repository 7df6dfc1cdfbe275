"""Unit vectors, and frames made of directions, for whole clips."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Float = NDArray[np.float64]

TINY = 1e-9


def unit(vector: Float) -> Float:
    """Vectors of length 1, (..., n); zero stays zero."""
    length = np.sqrt(np.einsum("...i,...i->...", vector, vector))
    return vector / np.maximum(length, TINY)[..., None]


def cross(first: Float, second: Float) -> Float:
    """Cross products of vectors, (..., 3); for a clip's worth of them three times as fast as `np.cross`."""
    a, b, c = first[..., 0], first[..., 1], first[..., 2]
    x, y, z = second[..., 0], second[..., 1], second[..., 2]
    one = b * z - c * y
    found = np.empty((*one.shape, 3), one.dtype)
    found[..., 0], found[..., 1], found[..., 2] = one, c * x - a * z, a * y - b * x
    return found


def frame(left: Float, up: Float) -> Float:
    """Rotations with y axis along `left` and z axis as near to `up` as possible, (..., 3) -> (..., 3, 3)."""
    y = unit(left)
    x = unit(cross(y, up))
    return np.stack([x, y, cross(x, y)], axis=-1)


def in_frame(rotation: Float, vector: Float) -> Float:
    """World vectors (T, 3) expressed in the axes of rotations (T, 3, 3)."""
    local: Float = np.einsum("tji,tj->ti", rotation, vector)
    return local
