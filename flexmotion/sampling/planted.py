"""`planted`: feet that carry load stay where they are on the floor, and the body above them moves instead.

A model's errors of a degree at every joint of a leg move its foot by centimetres; the root, which it knows no better,
is moved so that the feet that it says are loaded neither leave the floor nor slide, but for gliding aside. What is left
where two feet disagree, or land sooner than a body can be let down, the legs make up for.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import convolve1d, maximum_filter1d
from scipy.signal import lfilter

from flexmotion.human.kinematics import HumanKinematics, forward
from flexmotion.human.motion import Motion
from flexmotion.sampling.leg_length import lowered
from flexmotion.spatial.heading import continuous_matrix_heading

Float = NDArray[np.float64]

ROLLING = 0.01
"""Heel and toe share what a foot does by the exponential of their height over this [m]."""

CHOOSING = 0.2
"""Of two feet the slower one stands: they share by the exponential of their speed over this [m/s]."""
MISJUDGED, NEAR = 0.1, 0.05
"""A foot no higher than the second [m] may stand, too, where it is not said to while the other is, for so much less."""
PLANTED, SWINGING = 1.5, 2.5
"""A foot slower than the first stands, one faster than the second swings, whatever they are said to carry [m/s]. Higher
than what a contact detector asks: here a whole body glides, as fast as people walk."""
GLIDING = 0.3
"""Aside feet are held less and less up to this speed, and from it on are left to glide [m/s]: the data hold next to no
steps aside, and a model that is to go there slides on its feet. A robot steps after them."""

ABOVE, BELOW = 0.015, 0.0
"""Heights of the lower one of heel and toe of a foot that stands; as in clips, whose shoes have soles [m]."""

REACHED, SUNK = 0.02, 0.003
"""A loaded foot that is higher than this in the end is let down to it by its leg; any that is deeper comes up [m]."""
MOST = 0.03
"""But no further than this: a knee that is nearly straight turns by 30 degrees for as much [m]."""

SMOOTH, ALONG = np.array([0.25, 0.5, 0.25]), np.array([1, 2, 3, 2, 1]) / 9.0
"""How frames share in what is done to one of them: the root's shift, and what a leg makes up for."""

SETTLING_S = 0.05
"""Time constant with which the body is raised or lowered: a window begins where the last one was put and goes over to
where the model has it in some tenths of a second, to be followed closely."""


def planted(motion: Motion, past: Motion) -> Motion:
    """A motion whose loaded feet stand.

    Args:
        motion: with contacts; without them it is returned as it is.
        past: what it goes on from, of the same body and frame rate, at least one frame.
    """
    if motion.contacts is None or not len(motion):
        return motion
    last = past[len(past) - 1 :]
    human = forward(motion)
    feet = np.concatenate([_feet(forward(last)), _feet(human)])  # (T + 1, 2, 2, 3): left and right, heel and toe
    loaded = motion.contacts.astype(np.float64)
    share = np.exp(-(feet[..., 2] - feet[..., 2].min(axis=2, keepdims=True)) / ROLLING)
    share = (share[1:] + share[:-1])[..., None]
    velocity = np.diff(feet[..., :2], axis=0) * motion.fps
    slip = (share * velocity).sum(axis=2) / share.sum(axis=2)
    speed = np.linalg.norm(slip, axis=-1)
    height = feet[1:, ..., 2].min(axis=2)
    may = np.where(loaded > 0.0, 1.0, MISJUDGED * (height < NEAR)) * loaded.any(axis=1, keepdims=True)
    firm = may * np.exp(-speed / CHOOSING)
    stands = np.clip((SWINGING - speed) / (SWINGING - PLANTED), 0.0, 1.0)
    # Ahead a body is where its legs carry it; what it glides aside is all that it knows of stepping aside.
    yaw = continuous_matrix_heading(human.pelvis_rotation)[:, None]
    facing = np.stack([np.cos(yaw), np.sin(yaw)], axis=-1)
    ahead = (slip * facing).sum(axis=-1, keepdims=True) * facing
    aside = slip - ahead
    holds = np.clip(1.0 - np.linalg.norm(aside, axis=-1, keepdims=True) / GLIDING, 0.0, 1.0)
    held = stands[..., None] * (ahead + holds * aside)
    shift = (firm[..., None] * held).sum(axis=1) / np.maximum(firm.sum(axis=1), np.finfo(float).tiny)[:, None]
    shift = convolve1d(shift, SMOOTH, axis=0, mode="nearest")

    error = np.clip(height, BELOW, ABOVE) - height
    wanted = _held((loaded * error).sum(axis=1) / np.maximum(loaded.sum(axis=1), 1.0), np.asarray(loaded.any(axis=1)))
    position = motion.root_position.copy()
    position[:, :2] -= np.cumsum(shift, axis=0) / motion.fps
    lift = _settled(wanted, motion.fps)
    position[:, 2] += lift
    down = _remaining(height + lift[:, None], motion.contacts)
    return lowered(replace(motion, root_position=position), down, human.hip, human.ankle)


def _remaining(height: Float, loaded: NDArray[np.bool_]) -> Float:
    """By how much feet are to come down, loaded ones to the floor and all out of it, heights and result (T, 2)."""
    down = _spread(np.where(loaded, np.maximum(height - REACHED, 0.0), 0.0))
    found: Float = np.minimum(down, np.maximum(height, 0.0)) - _spread(np.maximum(-height - SUNK, 0.0))
    return found


def _spread(amount: Float) -> Float:
    """The frames around come along: no foot drops or rises within one, (T, 2)."""
    reaching = maximum_filter1d(np.minimum(amount, MOST), len(ALONG), axis=0)
    spread: Float = convolve1d(reaching, ALONG, axis=0, mode="nearest")
    return spread


def _feet(human: HumanKinematics) -> Float:
    """Heel and toe of both feet, (T, 2, 2, 3) [m]."""
    return np.stack([human.heel, human.toe], axis=2)


def _held(values: Float, known: NDArray[np.bool_]) -> Float:
    """Values, where they are not known the last that was, 0 before the first, (T,)."""
    last = np.maximum.accumulate(np.where(known, np.arange(1, len(values) + 1), 0))
    return np.concatenate([[0.0], values])[last]


def _settled(wanted: Float, fps: float) -> Float:
    """What follows `wanted` from 0 on as a critically damped spring does, (T,)."""
    step = 2.0 / (SETTLING_S * fps)
    # Implicit in its own speed: stable at any rate.
    kept, pull = 1.0 / (1.0 + step) ** 2, (step / (1.0 + step)) ** 2
    found: Float = lfilter([pull], [1.0, pull - kept - 1.0, kept], wanted)
    return found
