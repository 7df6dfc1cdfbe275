"""Compiled loops over the legs of a window, in closed form: legs that reach, stretch, and ease their changes."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexmotion.compiled import FLOAT, FLOATS, INT, INTS, compiled, fields, part

Float = NDArray[np.float64]
Int = NDArray[np.int64]


class Leg(NamedTuple):
    """Lengths of a leg.

    Attributes:
        thigh, shank: [m].
        shortest, longest: distances of hip and ankle that legs are bent and stretched to [m].
        ahead, down: from the ankle to the middle of the sole, in the axes of a foot that stands flat [m].
    """

    thigh: float
    shank: float
    shortest: float
    longest: float
    ahead: float
    down: float


_LEG = fields(Leg, *[FLOAT] * 6)


@part
def _turned(rotation: Float, x: float, y: float, z: float) -> tuple[float, float, float]:
    """A vector turned by a rotation."""
    return (
        rotation[0, 0] * x + rotation[0, 1] * y + rotation[0, 2] * z,
        rotation[1, 0] * x + rotation[1, 1] * y + rotation[1, 2] * z,
        rotation[2, 0] * x + rotation[2, 1] * y + rotation[2, 2] * z,
    )


@part
def _length(leg: Leg, knee: float) -> float:
    """Distance of hip and ankle at a knee angle [m]."""
    return math.sqrt(leg.thigh**2 + leg.shank**2 + 2.0 * leg.thigh * leg.shank * math.cos(knee))


@part
def _within(leg: Leg, own: float, wanted: float) -> float:
    """A wanted distance of hip and ankle, no farther than bent and straight legs reach, or are already [m]."""
    return min(max(wanted, min(leg.shortest, own)), max(leg.longest, own))


@part
def _knee(leg: Leg, distance: float) -> float:
    """Knee angle at a distance of hip and ankle, by the law of cosines [rad]."""
    cosine = (distance**2 - leg.thigh**2 - leg.shank**2) / (2.0 * leg.thigh * leg.shank)
    return math.acos(min(max(cosine, -1.0), 1.0))


@part
def _reach(
    leg: Leg, hip: Float, knee: float, ankle: float, x: float, y: float, z: float, found: Float
) -> tuple[float, float]:
    """Knee and ankle [rad] of a leg that reaches to a place from its hip, (x, y, z) [m]; writes the hip, (3, 3)."""
    distance = math.sqrt(x * x + y * y + z * z)
    bent = _knee(leg, _within(leg, _length(leg, knee), distance))
    a, b, c = _turned(hip, -leg.shank * math.sin(bent), 0.0, -leg.thigh - leg.shank * math.cos(bent))
    scale = max(math.sqrt(a * a + b * b + c * c), 1e-9)
    a, b, c = a / scale, b / scale, c / scale
    scale = max(distance, 1e-9)
    x, y, z = x / scale, y / scale, z / scale
    # The rotation of least angle from one to the other.
    u, v, w = b * z - c * y, c * x - a * z, a * y - b * x
    cosine = a * x + b * y + c * z
    share = 1.0 / (1.0 + cosine)
    for k in range(3):
        p, q, r = hip[0, k], hip[1, k], hip[2, k]
        along = share * (u * p + v * q + w * r)
        found[0, k] = along * u + cosine * p + (v * r - w * q)
        found[1, k] = along * v + cosine * q + (w * p - u * r)
        found[2, k] = along * w + cosine * r + (u * q - v * p)
    pitch = knee - ankle
    a, b, c = _turned(hip, math.cos(pitch), 0.0, -math.sin(pitch))
    ahead = found[0, 0] * a + found[1, 0] * b + found[2, 0] * c
    up = found[0, 2] * a + found[1, 2] * b + found[2, 2] * c
    more = math.atan2(-up, ahead) - pitch
    return bent, bent - pitch - (more - 2.0 * math.pi * np.rint(more / (2.0 * math.pi)))


@part
def _sole(leg: Leg, hip: Float, pitch: float) -> tuple[float, float, float]:
    """From the ankle to the middle of the sole, of a foot that is pitched against the thigh [m]."""
    cosine, sine = math.cos(pitch), math.sin(pitch)
    return _turned(hip, cosine * leg.ahead + sine * leg.down, 0.0, cosine * leg.down - sine * leg.ahead)


@compiled(_LEG, FLOATS[4], *[FLOATS[2]] * 2, FLOATS[3])
def reached(leg: Leg, hips: Float, knees: Float, ankles: Float, wanted: Float) -> tuple[Float, Float, Float]:
    """See `leg_reach.reached`."""
    found, bent, dorsal = np.empty_like(hips), np.empty_like(knees), np.empty_like(knees)
    for t in range(len(knees)):
        for side in range(2):
            x, y, z = wanted[t, side, 0], wanted[t, side, 1], wanted[t, side, 2]
            bent[t, side], dorsal[t, side] = _reach(
                leg, hips[t, side], knees[t, side], ankles[t, side], x, y, z, found[t, side]
            )
    return found, bent, dorsal


@compiled(_LEG, FLOATS[4], *[FLOATS[2]] * 2, FLOATS[3], FLOATS[2], INT)
def moved(
    leg: Leg, hips: Float, knees: Float, ankles: Float, by: Float, pelvis: Float, tilts: int
) -> tuple[Float, Float, Float]:
    """Rotations of the hips, and angles of knees and ankles, of legs whose soles are moved.

    Args:
        leg: lengths.
        hips: rotations, (T, 2, 3, 3); knees, ankles: angles, (T, 2) [rad].
        by: of the soles, in the world, (T, 2, 3) [m].
        pelvis: orientations, unit quaternions w x y z, (T, 4).
        tilts: times that a leg is solved for its sole, which tilts with it.
    """
    found, bent, dorsal = hips.copy(), knees.copy(), ankles.copy()
    for t in range(len(knees)):
        w, x, y, z = pelvis[t, 0], pelvis[t, 1], pelvis[t, 2], pelvis[t, 3]
        for side in range(2):
            a, b, c = by[t, side, 0], by[t, side, 1], by[t, side, 2]
            if a == 0.0 and b == 0.0 and c == 0.0:
                continue
            hip, now, knee, ankle = hips[t, side], found[t, side], knees[t, side], ankles[t, side]
            # From hip to ankle and sole, and where that is to be, in the axes of the pelvis.
            p, q, r = _turned(hip, -leg.shank * math.sin(knee), 0.0, -leg.thigh - leg.shank * math.cos(knee))
            u, v, s = _sole(leg, hip, knee - ankle)
            p += u + (1 - 2 * (y * y + z * z)) * a + 2 * (x * y + w * z) * b + 2 * (x * z - w * y) * c
            q += v + 2 * (x * y - w * z) * a + (1 - 2 * (x * x + z * z)) * b + 2 * (y * z + w * x) * c
            r += s + 2 * (x * z + w * y) * a + 2 * (y * z - w * x) * b + (1 - 2 * (x * x + y * y)) * c
            for _ in range(tilts):
                flexed, risen = _reach(leg, hip, knee, ankle, p - u, q - v, r - s, now)
                u, v, s = _sole(leg, now, flexed - risen)
                bent[t, side], dorsal[t, side] = flexed, risen
    return found, bent, dorsal


@compiled(FLOATS[2], FLOATS[2], FLOATS[1], FLOATS[2])
def eased(joints: Float, changed: Float, weights: Float, limits: Float) -> Float:
    """Joints with changes that are smoothed over frames, (T, J) [rad].

    They begin from none and go on at their speed: windows follow each other without a jump of that.

    Args:
        joints, changed: before and after the changes, (T, J) [rad].
        weights: of neighbours in time, an odd number of them.
        limits: least and greatest angle, (J, 2) [rad]; what is beyond them already stays there.
    """
    frames, count, half = len(joints), joints.shape[1], len(weights) // 2
    found, change = joints.copy(), np.zeros(frames + 2 * half)
    for j in range(count):
        moves = False
        for t in range(frames):
            off = changed[t, j] - joints[t, j]
            # Other turns of the same joint.
            change[half + t] = off - 2.0 * math.pi * np.rint(off / (2.0 * math.pi))
            moves = moves or change[half + t] != 0.0
        if not moves:
            continue
        last = half + frames - 1
        for k in range(1, half + 1):
            change[last + k] = 2.0 * change[last] - change[max(last - k, 0)]
        for t in range(frames):
            total = 0.0
            for k in range(len(weights)):
                total += weights[k] * change[t + k]
            low, high = min(limits[j, 0], joints[t, j]), max(limits[j, 1], joints[t, j])
            found[t, j] = min(max(joints[t, j] + total, low), high)
    return found


@compiled(_LEG, FLOATS[2], FLOATS[2], *[FLOATS[3]] * 2, *[INTS[1]] * 3)
def stretched(
    leg: Leg, joints: Float, down: Float, hip: Float, ankle: Float, hips: Int, knees: Int, ankles: Int
) -> Float:
    """See `leg_length.lowered`; hips, knees, ankles: joints of left and right leg, (2,)."""
    found = joints.copy()
    for t in range(len(joints)):
        for side in range(2):
            x, y = hip[t, side, 0] - ankle[t, side, 0], hip[t, side, 1] - ankle[t, side, 1]
            z = hip[t, side, 2] - ankle[t, side, 2]
            # An inclined leg stretches by more than the foot is lowered; the bound keeps level legs from doing so.
            steep = max(z / max(math.sqrt(x * x + y * y + z * z), 1e-6), 0.5)
            knee = joints[t, knees[side]]
            own = _length(leg, knee)
            wanted = _within(leg, own, own + down[t, side] / steep)
            bent = max(knee, 0.0) if wanted == own else _knee(leg, wanted)
            turned = math.atan2(leg.shank * math.sin(bent), leg.thigh + leg.shank * math.cos(bent))
            turned -= math.atan2(leg.shank * math.sin(knee), leg.thigh + leg.shank * math.cos(knee))
            found[t, knees[side]] = bent
            found[t, hips[side]] += turned
            found[t, ankles[side]] += (bent - knee) - turned
    return found
