"""Compiled loops of `balance`: the problem of the horizontal path, and the iterations of both."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import types
from numpy.typing import NDArray

from flexmotion.compiled import BOOL, FLOAT, FLOATS, INT, compiled, fields, part

Float = NDArray[np.float64]
Flags = NDArray[np.bool_]


class Limits(NamedTuple):
    """What bounds iterations and shifts; see `balance`.

    Attributes:
        relaxed: over-relaxation.
        rounds: iterations.
        projections: half-planes that a point is brought behind in one iteration.
        farthest: greatest change of the shift from frame to frame [m].
    """

    relaxed: float
    rounds: int
    projections: int
    farthest: float


class Ends(NamedTuple):
    """What is asked of the capture point in the last frame.

    Attributes:
        asked: whether anything is.
        ahead: what a change over `calm` frames adds to a place, over that change.
        calm: those frames.
        stays: share of the shift of the last frame that counts.
        taken: from the place of the capture point, (2,) [m].
        bounds: of its region, (32,) [m].
        weight: of it.
    """

    asked: bool
    ahead: float
    calm: int
    stays: float
    taken: Float
    bounds: Float
    weight: float


class Frames(NamedTuple):
    """What the frames of a window are judged by.

    Attributes:
        known: frames without a shift.
        first: one with a constraint; the last one has none.
        light: vertical force over the mass from which on there is a zero-moment point [m/s²].
        nowhere: bound of a region without points [m].
        margin: distance from the edges of the regions [m].
        ease: weight of an acceleration that the ground cannot give.
        outward: directions of the edges, (2, 32).
    """

    known: int
    first: int
    light: float
    nowhere: float
    margin: float
    ease: float
    outward: Float


_BOOLS = types.Array(BOOL, 1, "C")
_LIMITS = fields(Limits, FLOAT, INT, INT, FLOAT)
_FRAMES = fields(Frames, INT, INT, FLOAT, FLOAT, FLOAT, FLOAT, FLOATS[2])
_ENDS = fields(Ends, BOOL, FLOAT, INT, FLOAT, FLOATS[1], FLOATS[1], FLOAT)


@part
def _slowed(shift: Float, known: int, farthest: float) -> Float:
    """A shift (M, K) from rest after known frames of none, (N, K), scaled so that no step is longer than `farthest`."""
    rows, axes = shift.shape
    found, longest = np.zeros((known + rows, axes)), 0.0
    for t in range(rows):
        square = 0.0
        for k in range(axes):
            step = shift[t, k] - (shift[t - 1, k] if t else 0.0)
            square += step * step
        longest = max(longest, square)
    scale = min(1.0, farthest / max(math.sqrt(longest), 1e-30))
    for t in range(rows):
        for k in range(axes):
            found[known + t, k] = shift[t, k] * scale
    return found


@part
def _add_product(found: Float, left: Float, right: Float) -> None:
    """Add a product of matrices to one, in place. Rows at a time: sums over neighbours in memory are not vectorised."""
    for row in range(found.shape[0]):
        for k in range(right.shape[0]):
            factor = left[row, k]
            for column in range(found.shape[1]):
                found[row, column] += factor * right[k, column]


@part
def _within(point: Float, edge: Float, outward: Float, projections: int) -> bool:
    """Bring points (R, 2) into regions that are bounded along `outward`, (2, 32), in place; whether any was outside."""
    outside = False
    for row in range(len(point)):
        for _ in range(projections):
            x, y = point[row, 0], point[row, 1]
            worst, most = -1, 0.0
            for k in range(edge.shape[1]):
                beyond = x * outward[0, k] + y * outward[1, k] - edge[row, k]
                if beyond > most:
                    worst, most = k, beyond
            if worst < 0:
                # What is not finite is nowhere.
                outside = outside or not math.isfinite(x + y)
                break
            outside = True
            point[row, 0] -= most * outward[0, worst]
            point[row, 1] -= most * outward[1, worst]
    return outside


@compiled(*[FLOATS[2]] * 6)
def shifted(
    shift: Float, more: Float, root: Float, force: Float, moment: Float, centre: Float
) -> tuple[Float, Float, Float, Float]:
    """Root, force, moment and centre of `Needs`, (N, 3) each, of a motion that is shifted.

    Args:
        shift: (N, 3) [m], and `more`: its second derivative [m/s²].
        root, force, moment, centre: before it.
    """
    roots, forces, moments, centres = root + shift, force + more, moment.copy(), centre + shift
    for t in range(len(shift)):
        for k in range(3):
            one, other = (k + 1) % 3, (k + 2) % 3
            moments[t, k] += centres[t, one] * more[t, other] - centres[t, other] * more[t, one]
            moments[t, k] += shift[t, one] * force[t, other] - shift[t, other] * force[t, one]
    return roots, forces, moments, centres


@compiled(*[FLOATS[2]] * 2, FLOATS[1], *[FLOATS[2]] * 3, _BOOLS, FLOAT, INT, _LIMITS)
def heights(
    start: Float,
    free: Float,
    base: Float,
    second: Float,
    gain: Float,
    answer: Float,
    borne: Flags,
    least: float,
    known: int,
    limits: Limits,
) -> Float:
    """Shift of the height, (N, 1) [m].

    Args:
        start: shift that the constrained problem has without forces, (M, 1) [m].
        free: shift without constraints, (M, 1) [m].
        base: vertical force without a shift, over the mass, (R,) [m/s²].
        second: what a shift adds to it, (R, M) [1/s²].
        gain: shift by forces, (M, R) [s²], and `answer`: forces by forces, (R, R).
        borne: whether the ground bears the body, (R,): the force is at least `least` [m/s²], else none.
        known: frames without a shift.
        limits: of iterations and shift.
    """
    rows = len(base)
    force, beyond = np.zeros((rows, 1)), False
    _add_product(force, second, free)
    low, high, given = np.empty(rows), np.empty(rows), np.empty(rows)
    for row in range(rows):
        force[row, 0] += base[row]
        low[row], high[row] = (least, np.inf) if borne[row] else (0.0, 0.0)
        given[row] = min(max(force[row, 0], low[row]), high[row])
        beyond = beyond or given[row] != force[row, 0]
    if not beyond:
        return _slowed(free, known, limits.farthest)
    centred, left, off = np.zeros((rows, 1)), np.zeros(rows), np.empty((rows, 1))
    _add_product(centred, second, start)
    for step in range(limits.rounds + 1):
        for row in range(rows):
            if step:
                ahead = limits.relaxed * (base[row] + force[row, 0]) + (1.0 - limits.relaxed) * given[row]
                given[row] = min(max(ahead + left[row], low[row]), high[row])
                left[row] += ahead - given[row]
            off[row, 0] = given[row] - left[row] - base[row]
            force[row, 0] = centred[row, 0]
        _add_product(force, answer, off)
    shift = start.copy()
    _add_product(shift, gain, off)
    return _slowed(shift, known, limits.farthest)


@compiled(*[FLOATS[2]] * 3, FLOATS[1], *[FLOATS[2]] * 5, _FRAMES, _ENDS, _LIMITS)
def places(
    force: Float,
    moment: Float,
    centre: Float,
    stays: Float,
    bounds: Float,
    second: Float,
    place: Float,
    start: Float,
    free: Float,
    frames: Frames,
    ends: Ends,
    limits: Limits,
) -> tuple[bool, Float, Float, Float, Float, Float, Float, Float]:
    """The problem of the place: R points, those of frames that have one and a region and the capture point if asked.

    Args:
        force, moment, centre: see `Needs`, (N, 3).
        stays: share of the region that stays where it is, (N,); none: (0,).
        bounds: of the regions, (N, 32) [m].
        second: second derivative of a shift, (N, M) [1/s²].
        place: Hessian without constraints, (M, M); start: negative gradient, (M, 2); free: shift without constraints,
            (M, 2) [m].
        frames: what they are judged by.
        ends: of the capture point.
        limits: of iterations and shift.

    Returns:
        Whether the free shift leaves a point outside; that shift, (N, 2) [m]; points without a shift, (R, 2) [m]; what
        a shift adds to them, (R, M); edges of their regions, (R, 32) [m]; points after the free shift, brought into
        these, (R, 2) [m]; Hessian of the problem with constraints, (M, M); right sides: `start`, then gradients by the
        points, (2 + R, M).
    """
    count, rows = len(force), 0
    unknown = count - frames.known
    base, moved = np.empty((count, 2)), np.empty((count, unknown))
    right, edge = np.empty((2 + count, unknown)), np.empty((count, bounds.shape[1]))
    for t in range(frames.first, count - 1):
        lift = force[t, 2]
        if lift <= frames.light or bounds[t, 0] <= frames.nowhere:
            continue
        lever = centre[t, 2] / lift
        base[rows, 0], base[rows, 1] = -moment[t, 1] / lift, moment[t, 0] / lift
        # An error of the zero-moment point counts as the acceleration that makes up for it.
        weight = frames.ease / (lever * lever)
        for k in range(unknown):
            moved[rows, k] = -lever * second[t, k]
        if len(stays) and t >= frames.known:
            moved[rows, t - frames.known] += stays[t]
        for k in range(unknown):
            right[2 + rows, k] = moved[rows, k] * weight
        for k in range(bounds.shape[1]):
            edge[rows, k] = bounds[t, k] - frames.margin
        rows += 1
    if ends.asked:
        before = count - 1 - ends.calm
        for axis in range(2):
            base[rows, axis] = (
                (1.0 + ends.ahead) * centre[count - 1, axis] - ends.ahead * centre[before, axis] - ends.taken[axis]
            )
        for k in range(unknown):
            moved[rows, k] = 0.0
        for k in range(bounds.shape[1]):
            edge[rows, k] = ends.bounds[k]
        moved[rows, unknown - 1] = ends.stays + ends.ahead
        if before >= frames.known:
            moved[rows, before - frames.known] = -ends.ahead
        for k in range(unknown):
            right[2 + rows, k] = ends.weight * moved[rows, k]
        rows += 1
    base, moved, edge, right = base[:rows], moved[:rows], edge[:rows], right[: 2 + rows]
    for axis in range(2):
        for k in range(unknown):
            right[axis, k] = start[k, axis]
    given = base.copy()
    _add_product(given, moved, free)
    outside, hessian = _within(given, edge, frames.outward, limits.projections), place.copy()
    if outside:
        _add_product(hessian, right[2:].T, moved)
    return outside, _slowed(free, frames.known, limits.farthest), base, moved, edge, given, hessian, right


@compiled(*[FLOATS[2]] * 3, types.Array(FLOAT, 2, "C"), FLOATS[2], _FRAMES, _LIMITS)
def brought(
    base: Float, moved: Float, edge: Float, given: Float, solved: Float, frames: Frames, limits: Limits
) -> Float:
    """The shift that brings points into their regions, (N, 2) [m].

    Args:
        base, moved, edge, given: of `places`; the last one is changed.
        solved: right sides of `places` over its Hessian, (2 + R, M).
        frames, limits: see `places`.
    """
    rows, unknown = moved.shape
    answer, gain, shift = np.zeros((rows, rows)), np.empty((unknown, rows)), np.empty((unknown, 2))
    for k in range(unknown):
        for row in range(rows):
            gain[k, row] = solved[2 + row, k]
        shift[k, 0], shift[k, 1] = solved[0, k], solved[1, k]
    _add_product(answer, moved, gain)
    # Sums of few columns: over neighbours in memory by the transposed matrix.
    point, off, left = np.empty((2, rows)), np.empty((2, rows)), np.zeros((rows, 2))
    centred, back = np.zeros((rows, 2)), np.ascontiguousarray(answer.T)
    _add_product(centred, moved, shift)
    for step in range(limits.rounds + 1):
        for row in range(rows):
            for axis in range(2):
                if step:
                    ahead = (
                        limits.relaxed * (base[row, axis] + point[axis, row])
                        + (1.0 - limits.relaxed) * given[row, axis]
                        + left[row, axis]
                    )
                    given[row, axis] = left[row, axis] = ahead
        if step:
            _within(given, edge, frames.outward, limits.projections)
        for row in range(rows):
            for axis in range(2):
                if step:
                    left[row, axis] -= given[row, axis]
                off[axis, row] = given[row, axis] - left[row, axis] - base[row, axis]
                point[axis, row] = centred[row, axis]
        _add_product(point, off, back)
    _add_product(shift, gain, off.T)
    return _slowed(shift, frames.known, limits.farthest)
