"""Pose of rigid clusters of markers, and the joint between two of them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Float = NDArray[np.float64]
Bool = NDArray[np.bool_]

PLANAR = 0.005
"""Least spread of a cluster across its longest direction, RMS [m]; below it the markers lie on a line."""


def visible(points: Float) -> Bool:
    """Which points have all three coordinates, (..., 3) -> (...,)."""
    return np.asarray(np.isfinite(points).all(axis=-1))


def cluster_pose(tracks: Float) -> tuple[Float, Float, Float]:
    """Pose of a cluster in every frame by least squares (Kabsch 1976).

    Args:
        tracks: of M markers, (T, M, 3) [m]; NaN where a marker is missing.

    Returns:
        rotation (T, 3, 3) and origin (T, 3) of the cluster, NaN in frames with fewer than three markers or with markers
        on a line; shape of the cluster about its own origin, (M, 3), NaN for a marker that is never seen with three
        others.
    """
    seen = visible(tracks)
    shape = _first_shape(tracks, seen)
    rotation, origin = _align(tracks, seen, shape)
    for _ in range(2):
        local = np.einsum("tji,tmj->tmi", rotation, tracks - origin[:, None])
        known = visible(local)
        shape = np.where(known[..., None], local, 0.0).sum(axis=0)
        shape = np.where((known.sum(axis=0) > 0)[:, None], shape / np.maximum(known.sum(axis=0), 1)[:, None], np.nan)
        rotation, origin = _align(tracks, seen, shape)
    return rotation, origin, shape


def _first_shape(tracks: Float, seen: Bool) -> Float:
    """Shape of the cluster in the first frame with most of its markers."""
    best = int(np.argmax(seen.sum(axis=1)))
    shape = np.where(seen[best][:, None], tracks[best], np.nan)
    centre = shape[seen[best]].mean(axis=0) if seen[best].any() else np.zeros(3)
    found: Float = shape - centre
    return found


def _align(tracks: Float, seen: Bool, shape: Float) -> tuple[Float, Float]:
    used = seen & visible(shape)
    weight = used / np.maximum(used.sum(axis=1), 1)[:, None]
    points, model = np.where(used[..., None], tracks, 0.0), np.nan_to_num(shape)
    middle, own = np.einsum("tm,tmi->ti", weight, points), weight @ model
    cross = np.einsum("tm,tmi,tmj->tij", weight, points - middle[:, None], model - own[:, None])
    left, _, right = np.linalg.svd(cross)
    sign = np.ones((len(tracks), 3))
    sign[:, 2] = np.linalg.det(left @ right)
    rotation = left @ (sign[..., None] * right)
    spread = np.linalg.svd(weight[..., None] * (model - own[:, None]), compute_uv=False) if len(model) > 1 else None
    flat = (used.sum(axis=1) < 3) | (spread is None or spread[:, 1] < PLANAR / np.sqrt(np.maximum(used.sum(axis=1), 1)))
    rotation[flat] = np.nan
    origin = middle - np.einsum("tij,tj->ti", rotation, own)
    return rotation, origin


def common_points(first: tuple[Float, Float], second: tuple[Float, Float]) -> tuple[Float, Float, Float, Float]:
    """Points that two moving bodies have in common: the centre and, of a hinge, the axis of their joint.

    Least squares of R1 c1 + t1 = R2 c2 + t2 over all frames (Ehrig et al. 2006, SCoRE); the direction in which the
    solution is least determined is the joint's axis (Ehrig et al. 2007, SARA).

    Args:
        first, second: rotation (T, 3, 3) and origin (T, 3) of the two bodies.

    Returns:
        centre in the first and in the second body, (3,) [m], nearest to both origins along the axis; axis in the first
        and in the second body, (3,), of unit length.
    """
    (r1, t1), (r2, t2) = first, second
    turn = np.einsum("tji,tjk->tik", r1, r2)
    shift = np.einsum("tji,tj->ti", r1, t2 - t1)
    eye = np.broadcast_to(np.eye(3), turn.shape)
    rows = np.concatenate([eye, -turn], axis=2).reshape(-1, 6)
    # Along the axis the rows do not determine the solution: the last singular direction is left out of it.
    left, size, right = np.linalg.svd(rows, full_matrices=False)
    solution = right[:5].T @ ((left[:, :5].T @ shift.reshape(-1)) / size[:5])
    one, two = right[5, :3], right[5, 3:]
    return solution[:3], solution[3:], one / np.linalg.norm(one), two / np.linalg.norm(two)
