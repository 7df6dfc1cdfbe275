"""Compiled loops over frames of features: rotations of balls and their angles, and the motion of decoded features."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import types
from numpy.typing import NDArray

from flexmotion.compiled import FLOAT, FLOATS, INT, INTS, compiled, fields, part

Float = NDArray[np.float64]
Int = NDArray[np.int64]


class Columns(NamedTuple):
    """Where blocks of features begin, and which joints they are of.

    Attributes:
        root, rotations, positions, wrenches: first columns of blocks; behind the positions are velocities and
            accelerations.
        ankles: first columns of left and right ankle, (2,).
        balls: joints of three hinges, (6, 3).
        signs: of their angles, (6, 3).
        hinges: joints of one hinge, in the order of their features, (8,).
    """

    root: int
    rotations: int
    positions: int
    wrenches: int
    ankles: Int
    balls: Int
    signs: Float
    hinges: Int


class Scale(NamedTuple):
    """Units of features.

    Attributes:
        fps: frames per second.
        leg: length of the leg [m].
        weight: of the body [N].
        firm: share of it on a foot that has a centre of pressure.
    """

    fps: float
    leg: float
    weight: float
    firm: float


class Start(NamedTuple):
    """The frame before a window: place, (2,) [m], heading [rad] and angles of the balls, (6, 3) [rad]."""

    place: Float
    yaw: float
    balls: Float


_COLUMNS = fields(Columns, *[INT] * 4, INTS[1], INTS[2], FLOATS[2], INTS[1])
_FEATURES = types.Array(types.float32, 2, "C")
_SCALE = fields(Scale, *[FLOAT] * 4)
_START = fields(Start, FLOATS[1], FLOAT, FLOATS[2])


@part
def _orthonormal(columns: Float, row: int, first: int, found: Float) -> None:
    """Write the rotation (3, 3) whose first two columns are nearest to six features of a row (Gram-Schmidt)."""
    a, b, c = columns[row, first], columns[row, first + 1], columns[row, first + 2]
    length = max(math.sqrt(a * a + b * b + c * c), 1e-8)
    a, b, c = a / length, b / length, c / length
    x, y, z = columns[row, first + 3], columns[row, first + 4], columns[row, first + 5]
    along = a * x + b * y + c * z
    x, y, z = x - along * a, y - along * b, z - along * c
    length = max(math.sqrt(x * x + y * y + z * z), 1e-8)
    x, y, z = x / length, y / length, z / length
    found[0, 0], found[1, 0], found[2, 0] = a, b, c
    found[0, 1], found[1, 1], found[2, 1] = x, y, z
    found[0, 2], found[1, 2], found[2, 2] = b * z - c * y, c * x - a * z, a * y - b * x


@part
def _angles(matrices: Float, start: Float, signs: Float) -> Float:
    """See `ball_angles`."""
    frames, balls = matrices.shape[:2]
    found, turn = np.empty((frames, balls, 3)), 2.0 * math.pi
    near, other, before, turns = np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    for ball in range(balls):
        for k in range(3):
            before[k], turns[k] = start[ball, k] * signs[ball, k], 0.0
        for t in range(frames):
            m = matrices[t, ball]
            near[0] = math.atan2(m[0, 2], m[2, 2])
            cosine, sine = math.cos(near[0]), math.sin(near[0])
            near[1] = math.atan2(-m[1, 2], sine * m[0, 2] + cosine * m[2, 2])
            # The last angle given the first: near gimbal lock each alone is noise, their combination is not.
            near[2] = math.atan2(-(cosine * m[0, 1] - sine * m[2, 1]), cosine * m[0, 0] - sine * m[2, 0])
            other[0], other[1], other[2] = near[0] + math.pi, math.pi - near[1], near[2] + math.pi
            nearer, farther = 0.0, 0.0
            for k in range(3):
                away, beyond = near[k] - before[k], other[k] - before[k]
                away -= turn * np.rint(away / turn)
                beyond -= turn * np.rint(beyond / turn)
                nearer += away * away
                farther += beyond * beyond
            taken = other if farther < nearer else near
            for k in range(3):
                turns[k] += np.rint((taken[k] - before[k]) / turn)
                before[k] = taken[k]
                found[t, ball, k] = (taken[k] - turn * turns[k]) * signs[ball, k]
    return found


@part
def _path(values: Float, root: int, start: Start, scale: Scale) -> tuple[Float, Float]:
    """See `root_path`."""
    frames = len(values)
    position, yaw = np.empty((frames, 3)), np.empty(frames)
    turned, x, y, before = 0.0, 0.0, 0.0, start.yaw
    for t in range(frames):
        ahead, aside = values[t, root], values[t, root + 1]
        cosine, sine = math.cos(before), math.sin(before)
        x += (cosine * ahead - sine * aside) * scale.leg / scale.fps
        y += (sine * ahead + cosine * aside) * scale.leg / scale.fps
        turned += values[t, root + 2]
        before = yaw[t] = start.yaw + turned / scale.fps
        position[t, 0], position[t, 1], position[t, 2] = (
            start.place[0] + x,
            start.place[1] + y,
            values[t, root + 3] * scale.leg,
        )
    return position, yaw


@part
def _quaternion(r: Float, found: Float) -> None:
    """Write the unit quaternion w x y z of a rotation (3, 3) whose greatest component is not negative."""
    w, x = 1.0 + r[0, 0] + r[1, 1] + r[2, 2], 1.0 + r[0, 0] - r[1, 1] - r[2, 2]
    y, z = 1.0 - r[0, 0] + r[1, 1] - r[2, 2], 1.0 - r[0, 0] - r[1, 1] + r[2, 2]
    a, b, c = r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1]
    d, e, f = r[0, 1] + r[1, 0], r[0, 2] + r[2, 0], r[1, 2] + r[2, 1]
    # 4 q qᵀ: any row is a multiple of the quaternion, that of the greatest component the one that rounding harms least.
    if w >= x and w >= y and w >= z:
        x, y, z = a, b, c
    elif x >= y and x >= z:
        w, y, z = a, d, e
    elif y >= z:
        w, x, z = b, d, f
    else:
        w, x, y = c, e, f
    length = math.sqrt(w * w + x * x + y * y + z * z)
    found[0], found[1], found[2], found[3] = w / length, x / length, y / length, z / length


@compiled(FLOATS[2])
def orthonormal(columns: Float) -> Float:
    """Rotation matrices, (N, 3, 3), from two columns each, (N, 6), by Gram-Schmidt orthonormalisation."""
    found = np.empty((len(columns), 3, 3))
    for row in range(len(columns)):
        _orthonormal(columns, row, 0, found[row])
    return found


@compiled(FLOATS[2])
def turns(columns: Float) -> tuple[Float, Float, Float]:
    """Rotations of K balls, (K, T, 3, 3), from six columns each, (T, 6 K), and cosines of their turns.

    Returns:
        Rotations; cosines of the turns of their third axes from each frame to the next, (K, T - 1); of whole turns.
    """
    frames, balls = len(columns), columns.shape[1] // 6
    found = np.empty((balls, frames, 3, 3))
    axis, whole = np.empty((balls, frames - 1)), np.empty((balls, frames - 1))
    for ball in range(balls):
        for t in range(frames):
            _orthonormal(columns, t, 6 * ball, found[ball, t])
            if t:
                trace, last = 0.0, 0.0
                for k in range(3):
                    last = 0.0
                    for row in range(3):
                        last += found[ball, t - 1, row, k] * found[ball, t, row, k]
                    trace += last
                axis[ball, t - 1], whole[ball, t - 1] = last, 0.5 * (trace - 1.0)
    return found, axis, whole


@part
def _ball_matrix(joints: Float, t: int, columns: Int, signs: Float, k: int, own: Float) -> None:
    """Write the rotation Ry(a) Rx(b) Rz(c) of a ball, (3, 3)."""
    x, y = joints[t, columns[k, 0]] * signs[k, 0], joints[t, columns[k, 1]] * signs[k, 1]
    z = joints[t, columns[k, 2]] * signs[k, 2]
    a, b, c = math.cos(x), math.cos(y), math.cos(z)
    sa, sb, sc = math.sin(x), math.sin(y), math.sin(z)
    tilted, turned = sa * sb, a * sb
    own[0, 0], own[0, 1], own[0, 2] = a * c + tilted * sc, tilted * c - a * sc, sa * b
    own[1, 0], own[1, 1], own[1, 2] = b * sc, b * c, -sb
    own[2, 0], own[2, 1], own[2, 2] = turned * sc - sa * c, sa * sc + turned * c, a * b


@compiled(FLOATS[2], INTS[2], FLOATS[2])
def ball_matrices(joints: Float, columns: Int, signs: Float) -> Float:
    """Rotations Ry(a) Rx(b) Rz(c) of K balls, (N, K, 3, 3), at angles of all joints, (N, J) [rad].

    Args:
        joints: see above.
        columns, signs: joints of the balls and the signs of their angles, (K, 3).
    """
    found = np.empty((len(joints), len(columns), 3, 3))
    for t in range(len(joints)):
        for k in range(len(columns)):
            _ball_matrix(joints, t, columns, signs, k, found[t, k])
    return found


@compiled(FLOATS[4], FLOATS[2], FLOATS[2])
def ball_angles(matrices: Float, start: Float, signs: Float) -> Float:
    """Angles of a sequence of rotations of K balls, (T, K, 3, 3) -> (T, K, 3) [rad]; see `joint_groups.ball_angles`.

    Args:
        matrices: see above.
        start: angles of the frame before the first, (K, 3) [rad].
        signs: of the angles, (K, 3).
    """
    return _angles(matrices, start, signs)


@compiled(FLOATS[2], _START, _SCALE)
def root_path(root: Float, start: Start, scale: Scale) -> tuple[Float, Float]:
    """Positions of the root, (T, 3) [m], and headings, (T,) [rad], from the block `root`, (T, 4)."""
    return _path(root, 0, start, scale)


@compiled(FLOATS[2], _COLUMNS, _START, _SCALE)
def decoded(values: Float, columns: Columns, start: Start, scale: Scale) -> tuple[Float, Float, Float, Float, Float]:
    """What features tell of the root, the joints and the ground.

    Args:
        values: features that are not normalised, (T, F).
        columns: where what is in them.
        start: the frame before.
        scale: their units.

    Returns:
        Positions of the root, (T, 3) [m]; its orientations, continuous in sign, (T, 4); joints, (T, J) [rad]; wrenches
        about the centres of pressure, (T, 2, 6) [N, N·m]; these, (T, 2, 3) [m].
    """
    frames, balls, hinges = len(values), len(columns.balls), len(columns.hinges)
    position, yaw = _path(values, columns.root, start, scale)
    quaternions, joints = np.empty((frames, 4)), np.empty((frames, 3 * balls + hinges))
    wrenches, centres = np.empty((frames, 2, 6)), np.empty((frames, 2, 3))
    matrices, pelvis, turned = np.empty((frames, balls, 3, 3)), np.empty((3, 3)), np.empty((3, 3))
    found, before, sign = np.empty(4), np.zeros(4), 1.0
    for t in range(frames):
        cosine, sine = math.cos(yaw[t]), math.sin(yaw[t])
        _orthonormal(values, t, columns.rotations, pelvis)
        for k in range(3):
            turned[0, k] = cosine * pelvis[0, k] - sine * pelvis[1, k]
            turned[1, k] = sine * pelvis[0, k] + cosine * pelvis[1, k]
            turned[2, k] = pelvis[2, k]
        _quaternion(turned, found)
        # Both signs are the same rotation; neighbours keep the one without a jump.
        if found[0] * before[0] + found[1] * before[1] + found[2] * before[2] + found[3] * before[3] < 0.0:
            sign = -sign
        for k in range(4):
            before[k], quaternions[t, k] = found[k], sign * found[k]
        for ball in range(balls):
            _orthonormal(values, t, columns.rotations + 6 * (1 + ball), matrices[t, ball])
        for k in range(hinges):
            joints[t, columns.hinges[k]] = values[t, columns.rotations + 6 * (1 + balls) + k]
        for side in range(2):
            at, ankle = columns.wrenches + 6 * side, columns.ankles[side]
            a, b, z = values[t, at], values[t, at + 1], values[t, at + 2] * scale.weight
            x, y = (cosine * a - sine * b) * scale.weight, (sine * a + cosine * b) * scale.weight
            a, b, unit = values[t, at + 3], values[t, at + 4], scale.weight * scale.leg
            u, v, w = (cosine * a - sine * b) * unit, (sine * a + cosine * b) * unit, values[t, at + 5] * unit
            # The point of the floor about which the moment has no horizontal part.
            height, ahead, aside = values[t, ankle + 2] * scale.leg, 0.0, 0.0
            if z > scale.firm * scale.weight:
                ahead, aside = (-v - height * x) / z, (u - height * y) / z
            wrench, centre = wrenches[t, side], centres[t, side]
            wrench[0], wrench[1], wrench[2] = x, y, z
            wrench[3], wrench[4] = u - (aside * z + height * y), v - (-height * x - ahead * z)
            wrench[5] = w - (ahead * y - aside * x)
            a, b = values[t, ankle], values[t, ankle + 1]
            centre[0] = (cosine * a - sine * b) * scale.leg + position[t, 0] + ahead
            centre[1] = (sine * a + cosine * b) * scale.leg + position[t, 1] + aside
            centre[2] = values[t, ankle + 2] * scale.leg - height
    angles = _angles(matrices, start.balls, columns.signs)
    for t in range(frames):
        for ball in range(balls):
            for k in range(3):
                joints[t, columns.balls[ball, k]] = angles[t, ball, k]
    return position, quaternions, joints, wrenches, centres


@compiled(*[FLOATS[3]] * 2, FLOATS[4], *[FLOATS[2]] * 2, INTS[1], INT, _COLUMNS, _SCALE, _FEATURES)
def encoded(
    bodies: Float,
    sites: Float,
    rotations: Float,
    root: Float,
    joints: Float,
    places: Int,
    pelvis: int,
    columns: Columns,
    scale: Scale,
    features: NDArray[np.float32],
) -> tuple[Float, Float]:
    """Write the blocks of features that kinematics tell; return points, (T, P, 3) [m], and headings, (T,) [rad].

    Args:
        bodies, sites, rotations: of the model, (T, B, 3) [m], (T, S, 3) [m] and (T, B, 3, 3).
        root, joints: (T, 3) [m] and (T, J) [rad].
        places: of the points among bodies and, after these, sites, (P,).
        pelvis: its place among the bodies.
        columns: where what is in the features.
        scale: their units.
        features: (T, F), of which those blocks are written.
    """
    frames, count, size = len(root), len(places), bodies.shape[1]
    points, yaw = np.empty((frames, count, 3)), np.empty(frames)
    rates, own = np.zeros((3, frames, count, 3)), np.empty((3, 3))
    leg, fps, turns = scale.leg, scale.fps, 0.0
    for t in range(frames):
        for p in range(count):
            for k in range(3):
                place = places[p]
                points[t, p, k] = bodies[t, place, k] if place < size else sites[t, place - size, k]
        r = rotations[t, pelvis]
        yaw[t] = math.atan2(r[1, 0] - r[0, 1], r[0, 0] + r[1, 1]) + turns
        # Without jumps of 2π over time.
        if t and abs(yaw[t] - yaw[t - 1]) > math.pi:
            jump = 2.0 * math.pi * np.rint((yaw[t] - yaw[t - 1]) / (2.0 * math.pi))
            turns -= jump
            yaw[t] -= jump
        for p in range(count):
            for k in range(3):
                rates[0, t, p, k] = points[t, p, k] - (root[t, k] if k < 2 else 0.0)
    # Backward differences; of the first frame those of the second.
    for t in range(1, frames):
        for p in range(count):
            for k in range(3):
                rates[1, t, p, k] = (points[t, p, k] - points[t - 1, p, k]) * fps
                if t == 1:
                    rates[1, 0, p, k] = rates[1, 1, p, k]
    for t in range(1, frames):
        for p in range(count):
            for k in range(3):
                rates[2, t, p, k] = (rates[1, t, p, k] - rates[1, t - 1, p, k]) * fps
                if t == 1:
                    rates[2, 0, p, k] = rates[2, 1, p, k]
    for t in range(frames):
        now, before = (max(t, 1), max(t, 1) - 1) if frames > 1 else (0, 0)
        # Displacement since the last frame in the heading of that frame: its sum is exactly the path.
        cosine, sine = math.cos(yaw[max(t - 1, 0)]), math.sin(yaw[max(t - 1, 0)])
        x, y = (root[now, 0] - root[before, 0]) * fps, (root[now, 1] - root[before, 1]) * fps
        features[t, columns.root] = (cosine * x + sine * y) / leg
        features[t, columns.root + 1] = (cosine * y - sine * x) / leg
        features[t, columns.root + 2] = (yaw[now] - yaw[before]) * fps
        features[t, columns.root + 3] = root[t, 2] / leg
        cosine, sine, first = math.cos(yaw[t]), math.sin(yaw[t]), columns.rotations
        for k in range(2):
            x, y = rotations[t, pelvis, 0, k], rotations[t, pelvis, 1, k]
            features[t, first + 3 * k] = cosine * x + sine * y
            features[t, first + 3 * k + 1] = cosine * y - sine * x
            features[t, first + 3 * k + 2] = rotations[t, pelvis, 2, k]
        first += 6
        for ball in range(len(columns.balls)):
            _ball_matrix(joints, t, columns.balls, columns.signs, ball, own)
            for k in range(6):
                features[t, first + k] = own[k % 3, k // 3]
            first += 6
        for k in range(len(columns.hinges)):
            features[t, first + k] = joints[t, columns.hinges[k]]
        first = columns.positions
        for rate in range(3):
            for p in range(count):
                x, y = rates[rate, t, p, 0], rates[rate, t, p, 1]
                features[t, first] = (cosine * x + sine * y) / leg
                features[t, first + 1] = (cosine * y - sine * x) / leg
                features[t, first + 2] = rates[rate, t, p, 2] / leg
                first += 3
    return points, yaw
