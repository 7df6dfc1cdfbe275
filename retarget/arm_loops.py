"""Compiled loops over poses of arms: kinematics, cost in directions and depth, and the cheapest way through candidates.

`ArmChain`, `ArmCost`, `ArmPath` and `ArmBranches` say what is computed; here is the arithmetic of each pose, in the
torso frame. Arrays are (N, 2 sides, m joints, ...).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexmotion.compiled import FLOAT, FLOATS, INT, compiled, fields, part

Float = NDArray[np.float64]
Int = NDArray[np.int64]


class Arms(NamedTuple):
    """Both arms in the model's reference pose (Lynch and Park, Modern Robotics, 4.1).

    Attributes:
        axes, anchors: of the joints, (2, m, 3) [1, m]; tips: of the hands, (2, 3) [m].
        zero: joint angles of the reference pose, (2, m) [rad].
        shoulder, elbow: places of these joints in the chain; elbow -1: no joint divides the arm.
    """

    axes: Float
    anchors: Float
    tips: Float
    zero: Float
    shoulder: int
    elbow: int


class Body(NamedTuple):
    """Boxes that forearms keep clear of.

    Attributes:
        rotation, centre, half: of each box, (B, 3, 3), (B, 3) [m], (B, 3) [m].
        leans: 1 where a box is a thigh, which the trunk leans towards, (B,).
        hips: middle of the hips, (3,) [m].
        distance: that is kept [m].
        scale: cost of a depth, (2,) [1/m].
        shares: points along the forearm, as shares of its length from the elbow, (P,).
        lengths: of upper arm and forearm, (2, 2) [m].
    """

    rotation: Float
    centre: Float
    half: Float
    leans: Float
    hips: Float
    distance: float
    scale: Float
    shares: Float
    lengths: Float


class Weights(NamedTuple):
    """What an `ArmCost` weighs; see there.

    Attributes:
        shares: of the segments in the arm, (2, 2).
        rest: (2, m) [rad]; lower, upper: limits, (2, m) [rad].
        rest_weight, damping, held, in_the_body: see `ArmCost`.
    """

    shares: Float
    rest: Float
    lower: Float
    upper: Float
    rest_weight: float
    damping: float
    held: float
    in_the_body: float


class Wanted(NamedTuple):
    """What poses are compared with, by frame: directions (F, 2, 3) each, weight of the hand (F, 2), lean (F,) [rad].

    Each frame has as many poses as any other one, one after the other.
    """

    upper: Float
    fore: Float
    hand_weight: Float
    lean: Float


_ARMS = fields(Arms, FLOATS[3], FLOATS[3], FLOATS[2], FLOATS[2], INT, INT)
_BODY = fields(Body, FLOATS[3], *[FLOATS[2]] * 2, *[FLOATS[1]] * 2, FLOAT, *[FLOATS[1]] * 2, FLOATS[2])
_WEIGHTS = fields(Weights, *[FLOATS[2]] * 4, *[FLOAT] * 4)
_WANTED = fields(Wanted, FLOATS[3], FLOATS[3], FLOATS[2], FLOATS[1])


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


@part
def _place(arms: Arms, side: int, angles: Float, axis: Float, anchor: Float, hand: Float) -> None:
    """Write axes and anchors (m, 3) of an arm's joints, and its hand (3,), at its angles (m,)."""
    rotation, origin = np.eye(3), np.zeros(3)
    for k in range(len(angles)):
        for row in range(3):
            a, b = 0.0, origin[row]
            for column in range(3):
                a += rotation[row, column] * arms.axes[side, k, column]
                b += rotation[row, column] * arms.anchors[side, k, column]
            axis[k, row], anchor[k, row] = a, b
        _turn(rotation, arms.axes[side, k], angles[k] - arms.zero[side, k])
        # The joint's axis stays where it is.
        for row in range(3):
            origin[row] = anchor[k, row]
            for column in range(3):
                origin[row] -= rotation[row, column] * arms.anchors[side, k, column]
    for row in range(3):
        hand[row] = origin[row]
        for column in range(3):
            hand[row] += rotation[row, column] * arms.tips[side, column]


@part
def _segment(
    axis: Float, anchor: Float, first: int, begin: Float, end: Float, last: int, unit: Float, slope: Float
) -> None:
    """Write the unit vector (3,) from `begin` to `end`, and its derivatives by the joints (m, 3).

    Joints up to `first` turn both points, those from `last` on neither.
    """
    along = end - begin
    length = math.sqrt(along[0] * along[0] + along[1] * along[1] + along[2] * along[2])
    for row in range(3):
        unit[row] = along[row] / length
    for k in range(len(axis)):
        if k >= last:
            slope[k] = 0.0
            continue
        moved = along if k <= first else end - anchor[k]
        slope[k, 0] = axis[k, 1] * moved[2] - axis[k, 2] * moved[1]
        slope[k, 1] = axis[k, 2] * moved[0] - axis[k, 0] * moved[2]
        slope[k, 2] = axis[k, 0] * moved[1] - axis[k, 1] * moved[0]
        stretch = slope[k, 0] * unit[0] + slope[k, 1] * unit[1] + slope[k, 2] * unit[2]
        for row in range(3):
            slope[k, row] = (slope[k, row] - stretch * unit[row]) / length


@part
def _segments(arms: Arms, axis: Float, anchor: Float, hand: Float, unit: Float, slope: Float) -> None:
    """Write unit vectors (2, 3) of upper arm and forearm and their derivatives (2, m, 3)."""
    count, shoulder = len(axis), anchor[arms.shoulder]
    if arms.elbow < 0:
        _segment(axis, anchor, arms.shoulder, shoulder, hand, count, unit[0], slope[0])
        unit[1], slope[1] = unit[0], slope[0]
    else:
        elbow = anchor[arms.elbow]
        _segment(axis, anchor, arms.shoulder, shoulder, elbow, arms.elbow, unit[0], slope[0])
        _segment(axis, anchor, arms.elbow, elbow, hand, count, unit[1], slope[1])


@compiled(_ARMS, FLOATS[3])
def poses(arms: Arms, q: Float) -> tuple[Float, Float, Float, Float]:
    """Segments of the arms at joint angles (N, 2, m) [rad].

    Returns:
        Shoulder, elbow and hand (N, 2, 3, 3) [m], the elbow at the hand where there is none; unit vectors of upper arm
        and forearm, (N, 2, 2, 3); their derivatives by the joints, (N, 2, 2, m, 3) [1/rad]; those of the hands,
        (N, 2, m, 3) [m/rad].
    """
    number, _, count = q.shape
    points, units = np.empty((number, 2, 3, 3)), np.empty((number, 2, 2, 3))
    slopes, hands = np.empty((number, 2, 2, count, 3)), np.empty((number, 2, count, 3))
    axis, anchor = np.empty((count, 3)), np.empty((count, 3))
    for n in range(number):
        for side in range(2):
            hand = points[n, side, 2]
            _place(arms, side, q[n, side], axis, anchor, hand)
            points[n, side, 0] = anchor[arms.shoulder]
            points[n, side, 1] = hand if arms.elbow < 0 else anchor[arms.elbow]
            _segments(arms, axis, anchor, hand, units[n, side], slopes[n, side])
            for k in range(count):
                moved = hand - anchor[k]
                hands[n, side, k, 0] = axis[k, 1] * moved[2] - axis[k, 2] * moved[1]
                hands[n, side, k, 1] = axis[k, 2] * moved[0] - axis[k, 0] * moved[2]
                hands[n, side, k, 2] = axis[k, 0] * moved[1] - axis[k, 1] * moved[0]
    return points, units, slopes, hands


@part
def _depth(body: Body, begin: Float, hand: Float, share: float, lean: float, away: Float) -> float:
    """Depth of a point of a forearm in the body, weighted for no side [m]; writes the way out (3,)."""
    point, leaning, local = np.empty(3), np.empty(3), np.empty(3)
    for row in range(3):
        point[row] = begin[row] + share * (hand[row] - begin[row])
    # Legs seen from a trunk that leans forward by a pitch: as the point turned by it about the hips.
    c, s = math.cos(lean), math.sin(lean)
    x, z = point[0] - body.hips[0], point[2] - body.hips[2]
    leaning[0], leaning[1], leaning[2] = c * x + s * z + body.hips[0], point[1], c * z - s * x + body.hips[2]
    deepest = 0.0
    away[:] = 0.0
    for box in range(len(body.half)):
        leans = body.leans[box] > 0.0
        seen = leaning if leans else point
        farthest, outside = -np.inf, 0.0
        for row in range(3):
            total = 0.0
            for column in range(3):
                total += body.rotation[box, column, row] * (seen[column] - body.centre[box, column])
            local[row] = total
            beyond = abs(total) - body.half[box, row]
            farthest = max(farthest, beyond)
            outside += max(beyond, 0.0) ** 2
        # Most points are far from the body.
        if farthest >= body.distance:
            continue
        outside = math.sqrt(outside)
        found = body.distance - (farthest if outside == 0.0 else outside)
        if found <= deepest:
            continue
        deepest = found
        for row in range(3):
            beyond = abs(local[row]) - body.half[box, row]
            normal = max(beyond, 0.0) / outside if outside > 0.0 else 1.0 if beyond == farthest else 0.0
            local[row] = normal * np.sign(local[row])
        for row in range(3):
            away[row] = 0.0
            for column in range(3):
                away[row] += body.rotation[box, row, column] * local[column]
        if leans:
            x, z = away[0], away[2]
            away[0], away[2] = c * x - s * z, c * z + s * x
    return deepest


@part
def _depth_slope(body: Body, side: int, share: float, slope: Float, joint: int, away: Float) -> float:
    """Derivative of a weighted depth by a joint; the shoulder counts as at rest."""
    found = 0.0
    for row in range(3):
        upper, fore = body.lengths[side, 0] * slope[0, joint, row], body.lengths[side, 1] * slope[1, joint, row]
        found -= (upper + share * fore) * away[row]
    return body.scale[side] * found


@compiled(_BODY, FLOATS[3], FLOATS[3], FLOATS[5], FLOATS[1])
def depths(body: Body, begin: Float, hand: Float, slopes: Float, lean: Float) -> tuple[Float, Float]:
    """Weighted depths of the points of forearms, (N, 2, P), and their derivatives by the joints, (N, 2, m, P).

    Args:
        body: the boxes.
        begin, hand: where the forearms begin and end, (N, 2, 3) [m].
        slopes: derivatives of the unit vectors, as of `poses`.
        lean: pitch of the trunk forward, (N,) [rad].
    """
    number, count = len(begin), slopes.shape[3]
    depth = np.zeros((number, 2, len(body.shares)))
    slope = np.zeros((number, 2, count, len(body.shares)))
    away = np.empty(3)
    for n in range(number):
        for side in range(2):
            for p, share in enumerate(body.shares):
                depth[n, side, p] = body.scale[side] * _depth(body, begin[n, side], hand[n, side], share, lean[n], away)
                for k in range(count):
                    slope[n, side, k, p] = _depth_slope(body, side, share, slopes[n, side], k, away)
    return depth, slope


@part
def _factors(weights: Weights, side: int, hand_weight: float) -> tuple[float, float, float]:
    """Cholesky factor of [[1 + h a², h a b], [h a b, 1 + h b²]], the cost's weights of both differences."""
    a, b = weights.shares[side, 0], weights.shares[side, 1]
    first = math.sqrt(1.0 + hand_weight * a * a)
    mixed = hand_weight * a * b / first
    return first, mixed, math.sqrt(1.0 + hand_weight * b * b - mixed * mixed)


@compiled(_ARMS, _BODY, _WEIGHTS, _WANTED, FLOATS[3])
def costs(arms: Arms, body: Body, weights: Weights, wanted: Wanted, q: Float) -> Float:
    """Cost of poses (N, 2, m), (N, 2); see `ArmCost.of`."""
    number, _, count = q.shape
    out, each = np.empty((number, 2)), number // len(wanted.lean)
    axis, anchor, hand, away = np.empty((count, 3)), np.empty((count, 3)), np.empty(3), np.empty(3)
    unit, slope = np.empty((2, 3)), np.empty((2, count, 3))
    for n in range(number):
        frame = n // each
        for side in range(2):
            _place(arms, side, q[n, side], axis, anchor, hand)
            _segments(arms, axis, anchor, hand, unit, slope)
            first, mixed, second = _factors(weights, side, wanted.hand_weight[frame, side])
            total, deep = 0.0, 0.0
            for row in range(3):
                upper = unit[0, row] - wanted.upper[frame, side, row]
                fore = unit[1, row] - wanted.fore[frame, side, row]
                total += (first * upper + mixed * fore) ** 2 + (second * fore) ** 2
            begin = anchor[arms.shoulder if arms.elbow < 0 else arms.elbow]
            for share in body.shares:
                deep += (body.scale[side] * _depth(body, begin, hand, share, wanted.lean[frame], away)) ** 2
            out[n, side] = total + min(deep, weights.in_the_body)
    return out


@part
def _add(matrix: Float, push: Float, slope: Float, residual: float) -> float:
    """Add a residual and its derivatives (m,) to the equations; returns its square."""
    for i in range(len(slope)):
        push[i] += slope[i] * residual
        for j in range(len(slope)):
            matrix[i, j] += slope[i] * slope[j]
    return residual * residual


@part
def _equations(
    arms: Arms,
    body: Body,
    weights: Weights,
    wanted: Wanted,
    q: Float,
    clear: bool,
    matrix: Float,
    right: Float,
    cost: Float,
) -> None:
    """Write what `normal` returns."""
    number, _, count = q.shape
    each = number // len(wanted.lean)
    axis, anchor, hand, away = np.empty((count, 3)), np.empty((count, 3)), np.empty(3), np.empty(3)
    unit, slope, row_slope = np.empty((2, 3)), np.empty((2, count, 3)), np.empty(count)
    matrix[:], right[:], cost[:] = 0.0, 0.0, 0.0
    for n in range(number):
        frame = n // each
        for side in range(2):
            _place(arms, side, q[n, side], axis, anchor, hand)
            _segments(arms, axis, anchor, hand, unit, slope)
            first, mixed, second = _factors(weights, side, wanted.hand_weight[frame, side])
            own, push = matrix[n, side], right[n, side]
            for row in range(6):
                # Differences of the upper arm's direction come first, those of the forearm's last.
                x = row % 3
                a, b = (first, mixed) if row < 3 else (0.0, second)
                fore = unit[1, x] - wanted.fore[frame, side, x]
                residual = a * (unit[0, x] - wanted.upper[frame, side, x]) + b * fore
                for k in range(count):
                    row_slope[k] = a * slope[0, k, x] + b * slope[1, k, x]
                cost[n, side] += _add(own, push, row_slope, residual)
            if clear:
                begin = anchor[arms.shoulder if arms.elbow < 0 else arms.elbow]
                for share in body.shares:
                    depth = _depth(body, begin, hand, share, wanted.lean[frame], away)
                    if depth > 0.0:
                        for k in range(count):
                            row_slope[k] = _depth_slope(body, side, share, slope, k, away)
                        cost[n, side] += _add(own, push, row_slope, body.scale[side] * depth)
            for k in range(count):
                angle = q[n, side, k]
                push[k] = -push[k] - weights.rest_weight * (angle - weights.rest[side, k])
                low, high = angle <= weights.lower[side, k], angle >= weights.upper[side, k]
                if (low and push[k] < 0.0) or (high and push[k] > 0.0):
                    own[k], own[:, k], push[k] = 0.0, 0.0, 0.0
                    own[k, k] = weights.held
                own[k, k] += weights.damping + weights.rest_weight


@compiled(_ARMS, _BODY, _WEIGHTS, _WANTED, FLOATS[3])
def normal(arms: Arms, body: Body, weights: Weights, wanted: Wanted, q: Float) -> tuple[Float, Float, Float]:
    """Gauss-Newton equations of half the cost at poses (N, 2, m): (N, 2, m, m), (N, 2, m), and the cost (N, 2).

    See `ArmCost.normal`.
    """
    number, _, count = q.shape
    matrix, right, cost = np.empty((number, 2, count, count)), np.empty((number, 2, count)), np.empty((number, 2))
    _equations(arms, body, weights, wanted, q, True, matrix, right, cost)
    return matrix, right, cost


@compiled(_ARMS, _BODY, _WEIGHTS, _WANTED, FLOATS[3], FLOAT)
def improved(arms: Arms, body: Body, weights: Weights, wanted: Wanted, q: Float, longest: float) -> Float:
    """Poses (N, 2, m) after a Gauss-Newton step of each by itself in which no joint moves further than `longest` [rad].

    By directions alone; see `ArmCost.improved`.
    """
    number, _, count = q.shape
    matrix, right, cost = np.empty((number, 2, count, count)), np.empty((number, 2, count)), np.empty((number, 2))
    _equations(arms, body, weights, wanted, q, False, matrix, right, cost)
    for n in range(number):
        for side in range(2):
            if not (np.isfinite(matrix[n, side]).all() and np.isfinite(right[n, side]).all()):
                right[n, side] = np.nan  # the plan is refused by name; numba's solver would end it without
                continue
            step = np.linalg.solve(matrix[n, side], right[n, side])
            share = min(1.0, longest / max(np.abs(step).max(), 1e-12))
            for k in range(count):
                moved = q[n, side, k] + share * step[k]
                right[n, side, k] = min(max(moved, weights.lower[side, k]), weights.upper[side, k])
    return right


@part
def _beyond(q: Float, before: Float, reach: Float) -> float:
    """How much further than its reach the joint moves that exceeds it most, 0 where none does [rad]."""
    most = 0.0
    for k in range(len(q)):
        most = max(most, abs(q[k] - before[k]) - reach[k])
    return most


@compiled(FLOATS[4], FLOATS[3], FLOATS[2], FLOATS[2], FLOAT, FLOAT, FLOATS[2])
def cheapest(q: Float, cost: Float, start: Float, reach: Float, travel: float, winding: float, rest: Float) -> Float:
    """Poses of the cheapest way through candidates, (F, 2, m) [rad] (Viterbi 1967).

    Args:
        q: candidates, (F, K, 2, m) [rad]; cost: of each, (F, K, 2).
        start: angles before the first frame, (2, m) [rad]; reach: what joints can move in a frame, (2, m) [rad].
        travel: cost of a radian beyond reach; winding: of a squared radian from `rest`, (2, m), at the end.
    """
    frames, candidates, _, count = q.shape
    # Zeros: where costs are no numbers the first candidate is taken, and the way is told as what it is.
    out, before = np.empty((frames, 2, count)), np.zeros((frames, candidates), np.int64)
    total, now = np.empty(candidates), np.empty(candidates)
    for side in range(2):
        for c in range(candidates):
            total[c] = cost[0, c, side] + travel * _beyond(q[0, c, side], start[side], reach[side])
        for frame in range(1, frames):
            for c in range(candidates):
                now[c] = np.inf
                for b in range(candidates):
                    found = total[b] + travel * _beyond(q[frame, c, side], q[frame - 1, b, side], reach[side])
                    if found < now[c]:
                        now[c], before[frame, c] = found, b
            for c in range(candidates):
                total[c] = now[c] + cost[frame, c, side]
        for c in range(candidates):
            for k in range(count):
                total[c] += winding * (q[frames - 1, c, side, k] - rest[side, k]) ** 2
        best = np.argmin(total)
        for frame in range(frames - 1, -1, -1):
            out[frame, side] = q[frame, best, side]
            best = before[frame, best]
    return out


@compiled(FLOATS[3], FLOATS[4], INT)
def best_samples(cost: Float, samples: Float, candidates: int) -> Float:
    """The best sample of each of the best cells of every frame, (F, candidates, 2, m) [rad].

    Args:
        cost: of the samples of all cells, (2, F, cells * samples of each).
        samples: (cells, samples of each, 2, m) [rad].
        candidates: number of cells.
    """
    _, frames, _ = cost.shape
    cells, number, _, count = samples.shape
    out, least, best = np.empty((frames, candidates, 2, count)), np.empty(cells), np.empty(cells, np.int64)
    for side in range(2):
        for frame in range(frames):
            for cell in range(cells):
                own = cost[side, frame, cell * number : (cell + 1) * number]
                best[cell] = np.argmin(own)
                least[cell] = own[best[cell]]
            for place in range(candidates):
                cell = int(np.argmin(least))
                least[cell] = np.inf
                out[frame, place, side] = samples[cell, best[cell], side]
    return out


@compiled(FLOATS[4], FLOATS[3], FLOATS[3], FLOATS[2], FLOAT, FLOATS[2], FLOAT)
def path_equations(
    matrix: Float, right: Float, line: Float, damping: Float, bend: float, reach: Float, speed: float
) -> tuple[Float, Float]:
    """Equations of all frames of both arms, coupled by accelerations and by speeds beyond what joints can do.

    Args:
        matrix, right: of each frame by itself, (F, 2, m, m) and (F, 2, m).
        line: joint angles of the known frames before the first one, then of the frames, (known + F, 2, m) [rad].
        damping: added to each frame's diagonal, (F, 2).
        bend: weight of a squared second difference; speed: of a squared radian beyond `reach`, (2, m) [rad].

    Returns:
        Lower bands (2 m + 1, 2 F m) and right side (2 F m,), for LAPACK's dpbsv: of the left arm, then of the right.
    """
    frames, _, count = right.shape
    known = len(line) - frames
    bands, sides = np.zeros((2 * count + 1, 2 * frames * count)), np.empty(2 * frames * count)
    for side in range(2):
        first = side * frames * count
        for frame in range(frames):
            for i in range(count):
                at = first + frame * count + i
                sides[at] = right[frame, side, i]
                bands[0, at] = damping[frame, side]
                for j in range(i, count):
                    bands[j - i, first + frame * count + i] += matrix[frame, side, j, i]
        for joint in range(count):
            # Of a second difference x[t] - 2 x[t+1] + x[t+2], each squared.
            for t in range(len(line) - 2):
                found = bend * (line[t, side, joint] - 2.0 * line[t + 1, side, joint] + line[t + 2, side, joint])
                for i in range(3):
                    own = 1.0 if i != 1 else -2.0
                    row = t + i - known
                    if row < 0:
                        continue
                    at = first + row * count + joint
                    sides[at] -= own * found
                    for apart in range(3 - i):
                        bands[apart * count, at] += bend * own * (1.0 if i + apart != 1 else -2.0)
            for t in range(len(line) - 1):
                change = line[t + 1, side, joint] - line[t, side, joint]
                if abs(change) <= reach[side, joint]:
                    continue
                excess = speed * (change - np.sign(change) * reach[side, joint])
                row = t - known
                at = first + row * count + joint
                if row >= 0:
                    sides[at] += excess
                    bands[0, at] += speed
                    bands[count, at] -= speed
                if row >= -1:
                    sides[at + count] -= excess
                    bands[0, at + count] += speed
    return bands, sides
