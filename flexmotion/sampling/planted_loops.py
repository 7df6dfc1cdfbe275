"""Compiled loops of `planted`: how feet slip, and how far they are from the floor."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import types
from numpy.typing import NDArray

from flexmotion.compiled import BOOL, FLOAT, FLOATS, compiled, fields, part

Float = NDArray[np.float64]
Flags = NDArray[np.bool_]


class Holds(NamedTuple):
    """Constants of `planted` that say how far feet are held; see there."""

    rolling: float
    choosing: float
    misjudged: float
    near: float
    planted: float
    swinging: float
    gliding: float


_HOLDS = fields(Holds, *[FLOAT] * 7)
_FLAGS = types.Array(BOOL, 2, "C")


@compiled(FLOATS[4], _FLAGS, FLOATS[3], FLOAT, BOOL, _HOLDS)
def slips(
    feet: Float, contacts: Flags, pelvis: Float, fps: float, stays: bool, holds: Holds
) -> tuple[Float, Float, Float, Float, Float, Float]:
    """The fields of a `Slip`.

    Args:
        feet: heel and toe of both feet in the frame before, then in each frame, (T + 1, 2, 2, 3) [m].
        contacts: feet that carry load, (T, 2).
        pelvis: rotation, (T, 3, 3).
        fps: frames per second.
        stays: whether the body stays where it is.
        holds: constants.
    """
    frames = len(contacts)
    velocity, parts, firm = np.empty((frames, 2, 2)), np.empty((frames, 2, 2, 1)), np.empty((frames, 2))
    stands, facing, held = np.ones((frames, 2)), np.empty((frames, 1, 2)), np.ones((frames, 2, 1))
    for t in range(frames):
        x, y = pelvis[t, 0, 0] + pelvis[t, 1, 1], pelvis[t, 1, 0] - pelvis[t, 0, 1]
        yaw = math.atan2(y, x)
        ahead, aside = math.cos(yaw), math.sin(yaw)
        facing[t, 0, 0], facing[t, 0, 1] = ahead, aside
        bears = contacts[t, 0] or contacts[t, 1]
        for side in range(2):
            lowest, before = (
                min(feet[t + 1, side, 0, 2], feet[t + 1, side, 1, 2]),
                min(feet[t, side, 0, 2], feet[t, side, 1, 2]),
            )
            x, y, total = 0.0, 0.0, 0.0
            for end in range(2):
                share = math.exp(-(feet[t + 1, side, end, 2] - lowest) / holds.rolling)
                share += math.exp(-(feet[t, side, end, 2] - before) / holds.rolling)
                parts[t, side, end, 0] = share
                x += share * ((feet[t + 1, side, end, 0] - feet[t, side, end, 0]) * fps)
                y += share * ((feet[t + 1, side, end, 1] - feet[t, side, end, 1]) * fps)
                total += share
            x, y = x / total, y / total
            velocity[t, side, 0], velocity[t, side, 1] = x, y
            speed = math.hypot(x, y)
            if stays:
                firm[t, side] = 1.0 if contacts[t, side] else 0.0
                continue
            may = 1.0 if contacts[t, side] else holds.misjudged if lowest < holds.near and bears else 0.0
            firm[t, side] = may * math.exp(-speed / holds.choosing)
            stands[t, side] = min(max((holds.swinging - speed) / (holds.swinging - holds.planted), 0.0), 1.0)
            along = x * ahead + y * aside
            beside = math.hypot(x - along * ahead, y - along * aside)
            held[t, side, 0] = max(1.0 - beside / holds.gliding, 0.0)
    return velocity, parts, firm, stands, facing, held


@compiled(*[FLOATS[3]] * 1, *[FLOATS[2]] * 2, *[FLOATS[3]] * 2, FLOATS[1])
def made_up(velocity: Float, firm: Float, stands: Float, facing: Float, holds: Float, weights: Float) -> Float:
    """Velocity of the slip that the root makes up for, filtered over frames, (T, 2) [m/s].

    Args:
        velocity, firm, stands, facing, holds: see `Slip`.
        weights: of the filter, an odd number; what is beyond both ends is taken as even.
    """
    frames, half = len(firm), len(weights) // 2
    shift, found = np.zeros((frames, 2)), np.zeros((frames, 2))
    for t in range(frames):
        u, v = facing[t, 0, 0], facing[t, 0, 1]
        total = max(firm[t, 0] + firm[t, 1], 1e-300)
        for side in range(2):
            x, y = velocity[t, side, 0], velocity[t, side, 1]
            # Forward the legs carry the body; sideways gliding is the model's substitute for steps.
            along, hold = x * u + y * v, holds[t, side, 0]
            weight = firm[t, side] * stands[t, side]
            shift[t, 0] += weight * (along * u + hold * (x - along * u)) / total
            shift[t, 1] += weight * (along * v + hold * (y - along * v)) / total
    for t in range(frames):
        for k in range(len(weights)):
            at = min(max(t + k - half, 0), frames - 1)
            found[t, 0] += weights[k] * shift[at, 0]
            found[t, 1] += weights[k] * shift[at, 1]
    return found


@compiled(FLOATS[2], _FLAGS, FLOAT, FLOAT)
def wanted_lifts(height: Float, contacts: Flags, below: float, above: float) -> Float:
    """How far loaded feet are from the range of heights in which they stand, (T,) [m]; the last known one without any.

    Args:
        height: of both feet, (T, 2) [m].
        contacts: feet that carry load, (T, 2).
        below, above: range [m].
    """
    found, last = np.empty(len(height)), 0.0
    for t in range(len(height)):
        total, count = 0.0, 0
        for side in range(2):
            if contacts[t, side]:
                total += min(max(height[t, side], below), above) - height[t, side]
                count += 1
        if count:
            last = total / count
        found[t] = last
    return found


@part
def _spread(amount: Float, most: float, weights: Float) -> Float:
    """Amounts spread over neighbouring frames, so that no foot drops or rises within one, (T, 2)."""
    frames, half = len(amount), len(weights) // 2
    reaching, found = np.zeros(frames), np.zeros((frames, 2))
    for side in range(2):
        for t in range(frames):
            greatest = 0.0
            for at in range(max(t - half, 0), min(t + half + 1, frames)):
                greatest = max(greatest, min(amount[at, side], most))
            reaching[t] = greatest
        for t in range(frames):
            for k in range(len(weights)):
                found[t, side] += weights[k] * reaching[min(max(t + k - half, 0), frames - 1)]
    return found


@compiled(FLOATS[2], _FLAGS, *[FLOAT] * 4, FLOATS[1])
def remaining(
    height: Float, loaded: Flags, reached: float, sunk: float, down: float, up: float, weights: Float
) -> Float:
    """Distances by which the legs lower the feet: loaded feet to the floor, all feet out of it, (T, 2) [m].

    Args:
        height: of both feet, (T, 2) [m].
        loaded: feet that are lowered, (T, 2).
        reached, sunk: height and depth from which on feet are moved [m].
        down, up: the most that they are moved [m].
        weights: of a filter over frames, an odd number.
    """
    lower, raise_ = np.zeros(height.shape), np.zeros(height.shape)
    for t in range(len(height)):
        for side in range(2):
            if loaded[t, side]:
                lower[t, side] = max(height[t, side] - reached, 0.0)
            raise_[t, side] = max(-height[t, side] - sunk, 0.0)
    found, back = _spread(lower, down, weights), _spread(raise_, up, weights)
    for t in range(len(height)):
        for side in range(2):
            found[t, side] = min(found[t, side], max(height[t, side], 0.0)) - back[t, side]
    return found
