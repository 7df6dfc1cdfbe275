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
def _placed(origin: Float, axes: Float, local: Float, place: Float) -> None:
    """Write the places on the floor, (2, 2), of local coordinates on both soles, (2, 2) [m]."""
    for foot in range(2):
        x, y = local[foot, 0], local[foot, 1]
        for k in range(2):
            place[foot, k] = origin[foot, k] + axes[foot, k, 0] * x + axes[foot, k, 1] * y


@part
def _vertical(
    origin: Float,
    axes: Float,
    wanted: Float,
    share: Float,
    both: bool,
    sharing: Sharing,
    low: Float,
    high: Float,
    local: Float,
    inverse: Float,
    place: Float,
) -> None:
    """Change shares of the feet, (2,), and their centres of pressure, until they give the zero-moment point `wanted`.

    Args:
        origin, axes: of the soles, (2, 2) [m] and (2, 2, 2).
        wanted: (2,) [m].
        share: of the feet, (2,).
        both: whether both feet bear.
        sharing: constants.
        low, high: bounds of coordinates on the soles, (2, 2) [m].
        local: coordinates of the centres at first, not within their bounds, (2, 2) [m].
        inverse: of the axes, damped, (2, 2, 2).
        place: where centres are written, (2, 2) [m].
    """
    left, right, x, y = share[0], share[1], 0.0, 0.0
    slight, rounds = sharing.slight, sharing.rounds
    # At first they are brought within their bounds alone. One foot alone is done in one step.
    for step in range(2 + rounds):
        if step == 2 and not (both and max(abs(x), abs(y)) > sharing.met):
            break
        size = max(left * left + right * right, slight)
        for foot in range(2):
            pull = share[foot] / size
            for c in range(2):
                moved = 0.0 if step == 0 else (inverse[foot, c, 0] * x + inverse[foot, c, 1] * y) * pull
                local[foot, c] = min(max(local[foot, c] + moved, low[foot, c]), high[foot, c])
        _placed(origin, axes, local, place)
        if both and step:
            u, v = place[0, 0] - place[1, 0], place[0, 1] - place[1, 1]
            gained = (wanted[0] - place[1, 0] - left * u) * u + (wanted[1] - place[1, 1] - left * v) * v
            left = min(max(left + gained / max(u * u + v * v, slight), 0.0), 1.0)
            right = 1.0 - left
            share[0], share[1] = left, right
        x = wanted[0] - left * place[0, 0] - right * place[1, 0]
        y = wanted[1] - left * place[0, 1] - right * place[1, 1]


@part
def _oppose(x: float, y: float, common: Float, limit: Float, slight: float) -> None:
    """Add a force to one foot and take it from the other, as much of it as the friction of both allows."""
    room = np.inf
    for foot in range(2):
        room = min(room, max(limit[foot] - math.hypot(common[foot, 0], common[foot, 1]), 0.0))
    within = min(1.0, room / max(math.hypot(x, y), slight))
    common[0, 0] += within * x
    common[0, 1] += within * y
    common[1, 0] -= within * x
    common[1, 1] -= within * y


@part
def _lever(points: Float, usable: Flags) -> float:
    """Mean distance of the usable points of a foot from their centre [m]: lever of friction about it."""
    x, y, count, found = 0.0, 0.0, 0, 0.0
    for p in range(len(points)):
        if usable[p]:
            x, y, count = x + points[p, 0], y + points[p, 1], count + 1
    if not count:
        return 0.0
    x, y = x / count, y / count
    for p in range(len(points)):
        if usable[p]:
            found += math.hypot(points[p, 0] - x, points[p, 1] - y)
    return found / count


@part
def _horizontal(
    force: Float,
    moment: float,
    place: Float,
    lever: Float,
    predicted: Float,
    sharing: Sharing,
    common: Float,
    limit: Float,
    wrench: Float,
) -> None:
    """Write horizontal forces of both feet and moments about the vertical beside their vertical forces, (2, 6)."""
    left, right, slight = wrench[0, 2], wrench[1, 2], sharing.slight
    lift = left + right
    given = min(1.0, sharing.friction * lift / max(math.hypot(force[0], force[1]), slight))
    for foot in range(2):
        limit[foot] = sharing.friction * wrench[foot, 2]
        share = wrench[foot, 2] / (lift if lift > 0.0 else 1.0)
        common[foot, 0], common[foot, 1] = share * (force[0] * given), share * (force[1] * given)
    both = left > 0.0 and right > 0.0
    if both:
        share = left / lift
        x = predicted[0, 0] - share * (predicted[0, 0] + predicted[1, 0])
        y = predicted[0, 1] - share * (predicted[0, 1] + predicted[1, 1])
        _oppose(x, y, common, limit, slight)
    needed = moment
    for foot in range(2):
        needed -= place[foot, 0] * common[foot, 1] - place[foot, 1] * common[foot, 0]
    rest = needed
    for foot in range(2):
        most = limit[foot] * lever[foot]
        share = wrench[foot, 2] / (lift if lift > 0.0 else 1.0)
        wrench[foot, 5] = min(max(share * needed, -most), most)
        rest -= wrench[foot, 5]
    if both:
        # The rest by opposed forces across the line between the feet.
        x, y = place[0, 0] - place[1, 0], place[0, 1] - place[1, 1]
        scale = rest / max(x * x + y * y, slight)
        _oppose(-y * scale, x * scale, common, limit, slight)
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
    frames, least = len(force), sharing.least
    origin, axes, lattice, points = feet.origin, feet.axes, feet.lattice, feet.points
    height, usable, predicted, centres = feet.height, feet.usable, feet.predicted, feet.centres
    wrenches, on_floor = np.zeros((frames, 2, 6)), np.zeros((frames, 2, 3))
    wanted, share, place, inverse = np.empty(2), np.empty(2), np.empty((2, 2)), np.empty((2, 2, 2))
    low, high, local, common = np.empty((2, 2)), np.empty((2, 2)), np.empty((2, 2)), np.empty((2, 2))
    lever, limit = np.empty(2), np.empty(2)
    for t in range(frames):
        bears, total = 0, 0.0
        for foot in range(2):
            # A foot in the air keeps its lowest point, so that its bounds exist.
            lowest, any_usable = np.inf, False
            for p in range(len(lattice)):
                lowest = min(lowest, height[t, foot, p])
                any_usable = any_usable or usable[t, foot, p]
            for c in range(2):
                low[foot, c], high[foot, c] = np.inf, -np.inf
                for p in range(len(lattice)):
                    if usable[t, foot, p] or height[t, foot, p] <= lowest:
                        low[foot, c], high[foot, c] = (
                            min(low[foot, c], lattice[p, c]),
                            max(high[foot, c], lattice[p, c]),
                        )
            # A foot that bears has a little, so that one that the model forgot can take over.
            share[foot] = max(predicted[t, foot, 2], least) if any_usable else 0.0
            bears += 1 if any_usable else 0
            total += share[foot]
            # Damped: a foot that points straight down has no extent on the floor.
            x, y, u, v = axes[t, foot, 0, 0], axes[t, foot, 1, 0], axes[t, foot, 0, 1], axes[t, foot, 1, 1]
            a, b, d = x * x + y * y + sharing.damped, x * u + y * v, u * u + v * v + sharing.damped
            whole = a * d - b * b
            inverse[foot, 0, 0], inverse[foot, 0, 1] = (d * x - b * u) / whole, (d * y - b * v) / whole
            inverse[foot, 1, 0], inverse[foot, 1, 1] = (a * u - b * x) / whole, (a * v - b * y) / whole
            x, y = centres[t, foot, 0] - origin[t, foot, 0], centres[t, foot, 1] - origin[t, foot, 1]
            local[foot, 0] = inverse[foot, 0, 0] * x + inverse[foot, 0, 1] * y
            local[foot, 1] = inverse[foot, 1, 0] * x + inverse[foot, 1, 1] * y
            lever[foot] = _lever(points[t, foot], usable[t, foot])
        lift = max(force[t, 2], 0.0) if bears else 0.0
        lifted, total = lift > least, max(total, least)
        scale = lift if lifted else 1.0
        wanted[0], wanted[1] = -moment[t, 1] / scale, moment[t, 0] / scale
        share[0], share[1] = share[0] / total, share[1] / total
        both = lifted and bears == 2
        _vertical(origin[t], axes[t], wanted, share, both, sharing, low, high, local, inverse, place)
        for foot in range(2):
            wrenches[t, foot, 2] = share[foot] * lift if lifted else 0.0
        _horizontal(force[t], moment[t, 2], place, lever, predicted[t], sharing, common, limit, wrenches[t])
        for foot in range(2):
            for k in range(2):
                on_floor[t, foot, k] = place[foot, k] if wrenches[t, foot, 2] > 0.0 else origin[t, foot, k]
    return wrenches, on_floor
