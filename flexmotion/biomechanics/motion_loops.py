"""Compiled loops over the frames of a clip: derivatives, and what the masses of a human need."""

from __future__ import annotations

import numpy as np
from numba import types
from numpy.typing import NDArray

from flexmotion.compiled import FLOAT, FLOATS, INT, INTS, compiled, part

Float = NDArray[np.float64]
Int = NDArray[np.int64]

_WRITTEN = types.Array(FLOAT, 3, "C")


@part
def _first(t: int, frames: int, width: int) -> int:
    """First of the neighbours of a frame: those around it, as far as there are any."""
    return min(max(t - width // 2, 0), frames - width)


@compiled(FLOATS[2], FLOATS[2])
def differences(weights: Float, signal: Float) -> Float:
    """Weighted sums of neighbours in time, (T, n).

    Args:
        weights: of the neighbours of each frame, (T, K); K is odd, or T where that is less.
        signal: (T, n).
    """
    found = np.zeros_like(signal)
    for t in range(len(signal)):
        first = _first(t, len(signal), weights.shape[1])
        for k in range(weights.shape[1]):
            weight = weights[t, k]
            for column in range(signal.shape[1]):
                found[t, column] += weight * signal[first + k, column]
    return found


@compiled(*[FLOATS[2]] * 3, FLOATS[3], FLOATS[4], INTS[1], _WRITTEN, _WRITTEN, FLOAT)
def derive(
    once: Float,
    twice: Float,
    inertia: Float,
    com: Float,
    rotation: Float,
    which: Int,
    acceleration: Float,
    rate: Float,
    fps: float,
) -> None:
    """Write accelerations of centres of mass [m/s²] and d/dt (R I Rᵀ ω) [N·m] of some segments, (T, B, 3) each.

    Args:
        once, twice: weights of neighbours, see `differences`, for a step of 1.
        inertia: in the segments' own axes, (B, 3) [kg·m²].
        com, rotation: of the segments, (T, B, 3) [m] and (T, B, 3, 3).
        which: segments.
        acceleration, rate: of all segments; those of others are left.
        fps: frames per second.
    """
    frames, width = len(com), once.shape[1]
    momentum, local, turning = np.empty((frames, 3)), np.empty(3), np.empty((3, 3))
    for b in which:
        for t in range(frames):
            first = _first(t, frames, width)
            for row in range(3):
                total = 0.0
                for k in range(width):
                    total += twice[t, k] * com[first + k, b, row]
                acceleration[t, b, row] = total * fps**2
                for column in range(3):
                    total = 0.0
                    for k in range(width):
                        total += once[t, k] * rotation[first + k, b, row, column]
                    turning[row, column] = total * fps
            for axis in range(3):
                one, other = (axis + 1) % 3, (axis + 2) % 3
                # The antisymmetric part, in the segments' axes: finite differences are not exactly skew-symmetric.
                spin = 0.0
                for row in range(3):
                    spin += rotation[t, b, row, other] * turning[row, one]
                    spin -= rotation[t, b, row, one] * turning[row, other]
                local[axis] = 0.5 * inertia[b, axis] * spin
            for row in range(3):
                momentum[t, row] = (
                    rotation[t, b, row, 0] * local[0]
                    + rotation[t, b, row, 1] * local[1]
                    + rotation[t, b, row, 2] * local[2]
                )
        for t in range(frames):
            first = _first(t, frames, width)
            for row in range(3):
                total = 0.0
                for k in range(width):
                    total += once[t, k] * momentum[first + k, row]
                rate[t, b, row] = total * fps


@compiled(FLOATS[1], *[FLOATS[3]] * 3, FLOAT)
def whole_efforts(
    mass: Float, com: Float, acceleration: Float, rate: Float, gravity: float
) -> tuple[Float, Float, Float]:
    """Total force, and moment about the world's origin, that move all masses, over the mass; and their centre.

    Args:
        mass: of the segments, (B,) [kg].
        com, acceleration: of their centres of mass, (T, B, 3) [m, m/s²].
        rate: of angular momentum about these, (T, B, 3) [N·m].
        gravity: [m/s²].

    Returns:
        (T, 3) each [m/s², m²/s², m].
    """
    force, moment, centre = np.zeros((len(com), 3)), np.zeros((len(com), 3)), np.zeros((len(com), 3))
    whole = 0.0
    for b in range(len(mass)):
        whole += mass[b]
    for t in range(len(com)):
        for b in range(len(mass)):
            share = mass[b] / whole
            x, y, z = acceleration[t, b, 0], acceleration[t, b, 1], acceleration[t, b, 2] + gravity
            x, y, z = share * x, share * y, share * z
            u, v, w = com[t, b, 0], com[t, b, 1], com[t, b, 2]
            force[t, 0] += x
            force[t, 1] += y
            force[t, 2] += z
            moment[t, 0] += v * z - w * y + rate[t, b, 0] / whole
            moment[t, 1] += w * x - u * z + rate[t, b, 1] / whole
            moment[t, 2] += u * y - v * x + rate[t, b, 2] / whole
            centre[t, 0] += share * u
            centre[t, 1] += share * v
            centre[t, 2] += share * w
    return force, moment, centre


@compiled(INTS[1], *[FLOATS[3]] * 6, FLOATS[4], INTS[1], INTS[1], INT, FLOATS[3], FLOATS[3])
def torques(
    parent: Int,
    force: Float,
    com: Float,
    rate: Float,
    anchor: Float,
    axis: Float,
    position: Float,
    rotation: Float,
    bearer: Int,
    feet: Int,
    root: int,
    wrenches: Float,
    points: Float,
) -> Float:
    """Force on the root, moment about its axes, then moments about the hinges, (T, 6 + J) [N, N·m].

    Args:
        parent: of each segment, which is behind it, (B,); the first one is the world.
        force: m (c̈ - g) of each segment, less external forces, (T, B, 3) [N].
        com, rate: see `whole_efforts`.
        anchor, axis: of the hinges, (T, J, 3) [m, 1].
        position, rotation: of the segments, (T, B, 3) [m] and (T, B, 3, 3).
        bearer: segment that each hinge moves, (J,).
        feet: segments of left and right foot, (2,).
        root: segment that carries all others.
        wrenches, points: on the feet, (T, 2, 6) [N, N·m] and (T, 2, 3) [m].
    """
    frames, size, hinges = len(force), len(parent), len(bearer)
    found, sums = np.zeros((frames, 6 + hinges)), np.empty((size, 6))
    for t in range(frames):
        for b in range(size):
            x, y, z = force[t, b, 0], force[t, b, 1], force[t, b, 2]
            sums[b, 0], sums[b, 1], sums[b, 2] = x, y, z
            sums[b, 3] = com[t, b, 1] * z - com[t, b, 2] * y + rate[t, b, 0]
            sums[b, 4] = com[t, b, 2] * x - com[t, b, 0] * z + rate[t, b, 1]
            sums[b, 5] = com[t, b, 0] * y - com[t, b, 1] * x + rate[t, b, 2]
        for side in range(2):
            b = feet[side]
            x, y, z = wrenches[t, side, 0], wrenches[t, side, 1], wrenches[t, side, 2]
            sums[b, 0] -= x
            sums[b, 1] -= y
            sums[b, 2] -= z
            sums[b, 3] -= points[t, side, 1] * z - points[t, side, 2] * y + wrenches[t, side, 3]
            sums[b, 4] -= points[t, side, 2] * x - points[t, side, 0] * z + wrenches[t, side, 4]
            sums[b, 5] -= points[t, side, 0] * y - points[t, side, 1] * x + wrenches[t, side, 5]
        for b in range(size - 1, 0, -1):
            for k in range(6):
                sums[parent[b], k] += sums[b, k]
        x, y, z = sums[root, 0], sums[root, 1], sums[root, 2]
        a, e, f = position[t, root, 0], position[t, root, 1], position[t, root, 2]
        found[t, 0], found[t, 1], found[t, 2] = x, y, z
        a, e, f = sums[root, 3] - (e * z - f * y), sums[root, 4] - (f * x - a * z), sums[root, 5] - (a * y - e * x)
        for k in range(3):
            found[t, 3 + k] = rotation[t, root, 0, k] * a + rotation[t, root, 1, k] * e + rotation[t, root, 2, k] * f
        for j in range(hinges):
            b = bearer[j]
            x, y, z = sums[b, 0], sums[b, 1], sums[b, 2]
            a, e, f = anchor[t, j, 0], anchor[t, j, 1], anchor[t, j, 2]
            found[t, 6 + j] = (
                axis[t, j, 0] * (sums[b, 3] - (e * z - f * y))
                + axis[t, j, 1] * (sums[b, 4] - (f * x - a * z))
                + axis[t, j, 2] * (sums[b, 5] - (a * y - e * x))
            )
    return found
