"""Compiled loops over the frames of a limb: its pose after a change of its angles, and its equations."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from flexmotion.compiled import FLOAT, FLOATS, INTS, compiled, part

Float = NDArray[np.float64]
Int = NDArray[np.int64]


@part
def _turn(turn: Float, axis: Float, angle: float) -> None:
    """Turn a rotation (3, 3) by an angle about an axis of its own frame, in place (Rodrigues)."""
    x, y, z = axis[0], axis[1], axis[2]
    s, c = math.sin(angle), math.cos(angle)
    d = 1.0 - c
    for row in range(len(turn)):
        a, b, e = turn[row, 0], turn[row, 1], turn[row, 2]
        turn[row, 0] = a * (c + d * x * x) + b * (d * x * y + s * z) + e * (d * x * z - s * y)
        turn[row, 1] = a * (d * x * y - s * z) + b * (c + d * y * y) + e * (d * y * z + s * x)
        turn[row, 2] = a * (d * x * z + s * y) + b * (d * y * z - s * x) + e * (c + d * z * z)


@compiled(*[FLOATS[3]] * 3, INTS[1], FLOATS[2])
def moved(anchor: Float, axis: Float, points: Float, carried: Int, change: Float) -> tuple[Float, Float, Float]:
    """Hinges' anchors and axes, and points, after the angles have changed; see `LimbPose.moved`."""
    frames, hinges = change.shape
    anchors, axes, found = np.empty_like(anchor), np.empty_like(axis), np.empty_like(points)
    turn = np.empty((3, 3))
    for t in range(frames):
        for row in range(3):
            for k in range(3):
                turn[row, k] = 1.0 if row == k else 0.0
            anchors[t, 0, row] = anchor[t, 0, row]
        for hinge in range(hinges + 1):
            if hinge:
                _turn(turn, axis[t, hinge - 1], change[t, hinge - 1])
            # What is carried by so many hinges is seen from the last one of them.
            last = max(hinge - 1, 0)
            for row in range(3):
                a, b, e = turn[row, 0], turn[row, 1], turn[row, 2]
                if hinge < hinges:
                    axes[t, hinge, row] = a * axis[t, hinge, 0] + b * axis[t, hinge, 1] + e * axis[t, hinge, 2]
                    if hinge:
                        x, y = anchor[t, hinge, 0] - anchor[t, last, 0], anchor[t, hinge, 1] - anchor[t, last, 1]
                        z = anchor[t, hinge, 2] - anchor[t, last, 2]
                        anchors[t, hinge, row] = anchors[t, last, row] + (a * x + b * y + e * z)
                for p in range(len(carried)):
                    if carried[p] == hinge:
                        x, y = points[t, p, 0] - anchor[t, last, 0], points[t, p, 1] - anchor[t, last, 1]
                        z = points[t, p, 2] - anchor[t, last, 2]
                        found[t, p, row] = anchors[t, last, row] + (a * x + b * y + e * z)
    return anchors, axes, found


@compiled(*[FLOATS[3]] * 3, INTS[1], FLOATS[3], FLOATS[3], FLOAT)
def equations(
    anchor: Float, axis: Float, points: Float, carried: Int, places: Float, weight: Float, farthest: float
) -> tuple[Float, Float]:
    """Jᵀ J, (W, K, K), and Jᵀ r, (W, K), of each frame of a limb of K hinges.

    J is what an angle adds to the points, r what these lack of their places, both weighted.

    Args:
        anchor, axis, points, carried: see `LimbPose`.
        places, weight: see `limb_closing.Wanted`.
        farthest: distance that is made up for [m].
    """
    frames, hinges, count = axis.shape[0], axis.shape[1], len(carried)
    squares, pulled = np.zeros((frames, hinges, hinges)), np.zeros((frames, hinges))
    slope, missing = np.empty((hinges, 3)), np.empty(3)
    for t in range(frames):
        for p in range(count):
            length = 0.0
            for k in range(3):
                missing[k] = places[t, p, k] - points[t, p, k]
                length += missing[k] * missing[k]
            scale = max(math.sqrt(length) / farthest, 1.0)
            # A point is not moved by joints beyond it.
            for hinge in range(carried[p]):
                u, v, w = axis[t, hinge, 0], axis[t, hinge, 1], axis[t, hinge, 2]
                x, y = points[t, p, 0] - anchor[t, hinge, 0], points[t, p, 1] - anchor[t, hinge, 1]
                z = points[t, p, 2] - anchor[t, hinge, 2]
                slope[hinge, 0] = weight[t, p, 0] * (v * z - w * y)
                slope[hinge, 1] = weight[t, p, 1] * (w * x - u * z)
                slope[hinge, 2] = weight[t, p, 2] * (u * y - v * x)
                for k in range(3):
                    pulled[t, hinge] += slope[hinge, k] * (weight[t, p, k] * missing[k] / scale)
                for other in range(hinge + 1):
                    total = 0.0
                    for k in range(3):
                        total += slope[hinge, k] * slope[other, k]
                    squares[t, hinge, other] += total
                    if other < hinge:
                        squares[t, other, hinge] += total
    return squares, pulled
