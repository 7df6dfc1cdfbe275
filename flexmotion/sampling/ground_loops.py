"""Compiled loop of `ground_share`: what the ground gives to each foot, frame by frame."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import types
from numpy.typing import NDArray

from flexmotion.compiled import BOOL, FLOAT, FLOATS, INT, compiled, fields, part

Float = NDArray[np.float64]
Flags = NDArray[np.bool_]


class Feet(NamedTuple):
    """Soles over the floor, as `Soles`, over T frames, and what they carry.

    Attributes:
        origin, axes, lattice, points, height: see `Soles`.
        usable: whether the ground may act at a point, (T, 2, 12).
        predicted: wrenches of a model, (T, 2, 6) [N, N·m].
        centres: of pressure of the same, (T, 2, 3) [m].
    """

    origin: Float
    axes: Float
    lattice: Float
    points: Float
    height: Float
    usable: Flags
    predicted: Float
    centres: Float


class Sharing(NamedTuple):
    """Constants of `ground_share`.

    Attributes:
        rounds: alternations between centres and shares of two feet.
        met: distance from the zero-moment point at which a frame is done [m].
        damped: see `DAMPED`.
        slight: see `SLIGHT`.
        least: force below which there is nothing to share [N].
        friction: coefficient.
    """

    rounds: int
    met: float
    damped: float
    slight: float
    least: float
    friction: float


_FEET = fields(Feet, FLOATS[3], FLOATS[4], FLOATS[2], FLOATS[4], FLOATS[3], types.Array(BOOL, 3, "C"), *[FLOATS[3]] * 2)
_SHARING = fields(Sharing, INT, *[FLOAT] * 5)


@part
def _bounds(feet: Feet, t: int, foot: int, coordinate: int) -> tuple[float, float]:
    """Least and greatest coordinate of a foot's usable points [m]."""
    # A foot in the air keeps its lowest point, so that its bounds exist.
    lowest = np.inf
    for p in range(len(feet.lattice)):
        lowest = min(lowest, feet.height[t, foot, p])
    low, high = np.inf, -np.inf
    for p in range(len(feet.lattice)):
        if feet.usable[t, foot, p] or feet.height[t, foot, p] <= lowest:
            low, high = min(low, feet.lattice[p, coordinate]), max(high, feet.lattice[p, coordinate])
    return low, high


@part
def _vertical(
    feet: Feet, t: int, wanted: Float, share: Float, both: bool, sharing: Sharing, work: Float, place: Float
) -> None:
    """Change shares of the feet, (2,), and write their centres of pressure, (2, 2) [m]; `work`: (6, 2, 2).

    Centres of pressure, then shares, are moved towards the zero-moment point `wanted`, (2,) [m], in turn.
    """
    missing, low, high, local, inverse = work[0, 0], work[1], work[2], work[3], work[4:]
    for foot in range(2):
        axes = feet.axes[t, foot]
        # Damped: a foot that points straight down has no extent on the floor.
        a = axes[0, 0] * axes[0, 0] + axes[1, 0] * axes[1, 0] + sharing.damped
        b = axes[0, 0] * axes[0, 1] + axes[1, 0] * axes[1, 1]
        d = axes[0, 1] * axes[0, 1] + axes[1, 1] * axes[1, 1] + sharing.damped
        whole = a * d - b * b
        x, y = feet.centres[t, foot, 0] - feet.origin[t, foot, 0], feet.centres[t, foot, 1] - feet.origin[t, foot, 1]
        for k in range(2):
            inverse[foot, 0, k] = (d * axes[k, 0] - b * axes[k, 1]) / whole
            inverse[foot, 1, k] = (a * axes[k, 1] - b * axes[k, 0]) / whole
        for c in range(2):
            low[foot, c], high[foot, c] = _bounds(feet, t, foot, c)
            along = inverse[foot, c, 0] * x + inverse[foot, c, 1] * y
            local[foot, c] = min(max(along, low[foot, c]), high[foot, c])
    left, right = share[0], share[1]
    for k in range(2):
        for foot in range(2):
            axes = feet.axes[t, foot]
            place[foot, k] = feet.origin[t, foot, k] + axes[k, 0] * local[foot, 0] + axes[k, 1] * local[foot, 1]
        missing[k] = wanted[k] - left * place[0, k] - right * place[1, k]
    # One foot alone is done in one step.
    for step in range(1 + sharing.rounds):
        if step == 1:
            off = 0.0
            for k in range(2):
                off = max(off, abs(wanted[k] - left * place[0, k] - right * place[1, k]))
            if not both or not off > sharing.met:
                break
        size = max(left * left + right * right, sharing.slight)
        gained, square = 0.0, 0.0
        for foot in range(2):
            step_size = (left if foot == 0 else right) / size
            for c in range(2):
                moved = (inverse[foot, c, 0] * missing[0] + inverse[foot, c, 1] * missing[1]) * step_size
                local[foot, c] = min(max(local[foot, c] + moved, low[foot, c]), high[foot, c])
            axes = feet.axes[t, foot]
            for k in range(2):
                place[foot, k] = feet.origin[t, foot, k] + axes[k, 0] * local[foot, 0] + axes[k, 1] * local[foot, 1]
        for k in range(2):
            apart = place[0, k] - place[1, k]
            gained += (wanted[k] - place[1, k] - left * apart) * apart
            square += apart * apart
        if both:
            left = min(max(left + gained / max(square, sharing.slight), 0.0), 1.0)
            right = 1.0 - left
        for k in range(2):
            missing[k] = wanted[k] - place[1, k] - left * (place[0, k] - place[1, k])
    share[0], share[1] = left, right


@part
def _within_friction(x: float, y: float, common: Float, limit: Float, slight: float) -> float:
    """Share of an opposed force with which the force of neither foot exceeds its friction."""
    room = np.inf
    for foot in range(2):
        room = min(room, max(limit[foot] - math.hypot(common[foot, 0], common[foot, 1]), 0.0))
    return min(1.0, room / max(math.hypot(x, y), slight))


@part
def _lever(feet: Feet, t: int, foot: int) -> float:
    """Mean distance of the usable points from their centre [m]: lever of friction about it."""
    x, y, count, found = 0.0, 0.0, 0, 0.0
    for p in range(len(feet.lattice)):
        if feet.usable[t, foot, p]:
            x, y, count = x + feet.points[t, foot, p, 0], y + feet.points[t, foot, p, 1], count + 1
    if not count:
        return 0.0
    x, y = x / count, y / count
    for p in range(len(feet.lattice)):
        if feet.usable[t, foot, p]:
            found += math.hypot(feet.points[t, foot, p, 0] - x, feet.points[t, foot, p, 1] - y)
    return found / count


@part
def _horizontal(feet: Feet, t: int, force: Float, moment: float, place: Float, sharing: Sharing, wrench: Float) -> None:
    """Write horizontal forces of both feet and moments about the vertical beside their vertical forces, (2, 6)."""
    limit, common, share = np.empty(2), np.empty((2, 2)), np.empty(2)
    lift = wrench[0, 2] + wrench[1, 2]
    given = min(1.0, sharing.friction * lift / max(math.hypot(force[0], force[1]), sharing.slight))
    for foot in range(2):
        limit[foot] = sharing.friction * wrench[foot, 2]
        share[foot] = wrench[foot, 2] / (lift if lift > 0.0 else 1.0)
        for k in range(2):
            common[foot, k] = share[foot] * (force[k] * given)
    both = wrench[0, 2] > 0.0 and wrench[1, 2] > 0.0
    if both:
        left, right = feet.predicted[t, 0], feet.predicted[t, 1]
        x = left[0] - share[0] * (left[0] + right[0])
        y = left[1] - share[0] * (left[1] + right[1])
        within = _within_friction(x, y, common, limit, sharing.slight)
        for foot, sign in ((0, within), (1, -within)):
            common[foot, 0] += sign * x
            common[foot, 1] += sign * y
    needed = moment
    for foot in range(2):
        needed -= place[foot, 0] * common[foot, 1] - place[foot, 1] * common[foot, 0]
    rest = needed
    for foot in range(2):
        most = limit[foot] * _lever(feet, t, foot)
        wrench[foot, 5] = min(max(share[foot] * needed, -most), most)
        rest -= wrench[foot, 5]
    if both:
        # The rest by opposed forces across the line between the feet.
        x, y = place[0, 0] - place[1, 0], place[0, 1] - place[1, 1]
        scale = rest / max(x * x + y * y, sharing.slight)
        x, y = -y * scale, x * scale
        within = _within_friction(x, y, common, limit, sharing.slight)
        for foot, sign in ((0, within), (1, -within)):
            common[foot, 0] += sign * x
            common[foot, 1] += sign * y
    for foot in range(2):
        wrench[foot, 0], wrench[foot, 1] = common[foot, 0], common[foot, 1]


@compiled(FLOATS[2], FLOATS[2], _FEET, _SHARING)
def shares(force: Float, moment: Float, feet: Feet, sharing: Sharing) -> tuple[Float, Float]:
    """Wrenches about the centres of pressure, (T, 2, 6) [N, N·m], and these, (T, 2, 3) [m].

    Args:
        force, moment: that the motion needs in all, the moment about the world's origin, (T, 3) [N, N·m].
        feet: where the ground can give it, and what a model predicts.
        sharing: constants.
    """
    frames = len(force)
    wrenches, on_floor = np.zeros((frames, 2, 6)), np.zeros((frames, 2, 3))
    wanted, share, place, work = np.empty(2), np.empty(2), np.empty((2, 2)), np.empty((6, 2, 2))
    for t in range(frames):
        bears, total = 0, 0.0
        for foot in range(2):
            share[foot] = 0.0
            for p in range(len(feet.lattice)):
                if feet.usable[t, foot, p]:
                    # A foot that bears has a little, so that one that the model forgot can take over.
                    share[foot] = max(feet.predicted[t, foot, 2], sharing.least)
                    bears += 1
                    break
            total += share[foot]
        lift = max(force[t, 2], 0.0) if bears else 0.0
        lifted = lift > sharing.least
        wanted[0], wanted[1] = -moment[t, 1], moment[t, 0]
        for k in range(2):
            wanted[k] /= lift if lifted else 1.0
            share[k] /= max(total, sharing.least)
        _vertical(feet, t, wanted, share, lifted and bears == 2, sharing, work, place)
        for foot in range(2):
            wrenches[t, foot, 2] = share[foot] * lift if lifted else 0.0
        _horizontal(feet, t, force[t], moment[t, 2], place, sharing, wrenches[t])
        for foot in range(2):
            for k in range(2):
                on_floor[t, foot, k] = place[foot, k] if wrenches[t, foot, 2] > 0.0 else feet.origin[t, foot, k]
    return wrenches, on_floor
