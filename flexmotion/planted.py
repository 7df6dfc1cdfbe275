"""`planted`: feet that carry load stay where they are on the floor, and the body above them moves instead.

A model's errors of a degree at every joint of a leg move its foot by centimetres; the root, which it knows no better,
is moved so that the feet that it says are loaded neither slide nor leave the floor. Angles are left as they are. Of
two feet that it says are loaded while one is well above the other, as happens some frames before a foot lands and after
it has left, that one carries nothing, and the lower one all.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import convolve1d
from scipy.signal import lfilter

from flexmotion.kinematics import forward
from flexmotion.motion import Motion

Float = NDArray[np.float64]

ROLLING = 0.01
"""Heel and toe share what a foot does by the exponential of their height over this [m]."""

SWINGING = 0.6
"""A foot this fast is not planted, whatever it is said to carry [m/s]."""

ABOVE, BELOW = 0.015, 0.0
"""Heights of the lower one of heel and toe of a foot that stands; as in clips, whose shoes have soles [m]."""

RAISED = 0.02
"""A foot this much higher than another that carries load does not carry any itself [m]."""

SMOOTH = np.array([0.25, 0.5, 0.25])
SETTLING_S = 0.033
"""Time constant with which the body is raised or lowered: a window begins where the last one was put and goes over to
where the model has it in some tenths of a second, to be followed closely."""


def planted(motion: Motion, past: Motion) -> Motion:
    """A motion whose loaded feet stand, and whose raised ones are not loaded.

    Args:
        motion: with contacts; without them it is returned as it is.
        past: what it goes on from, of the same body and frame rate, at least one frame.
    """
    if motion.contacts is None or not len(motion):
        return motion
    last = past[len(past) - 1 :]
    feet = np.concatenate([_feet(last), _feet(motion)])  # (T + 1, 2, 2, 3): left and right, heel and toe
    motion = _relieved(motion, feet[1:, ..., 2].min(axis=2))
    loaded = np.asarray(motion.contacts, np.float64)
    share = np.exp(-(feet[..., 2] - feet[..., 2].min(axis=2, keepdims=True)) / ROLLING)
    share = (share[1:] + share[:-1])[..., None]
    velocity = np.diff(feet[..., :2], axis=0) * motion.fps
    slip = (share * velocity).sum(axis=2) / share.sum(axis=2)
    firm = loaded * np.clip(1.0 - np.linalg.norm(slip, axis=-1) / SWINGING, 0.0, 1.0)
    shift = (firm[..., None] * slip).sum(axis=1) / np.maximum(firm.sum(axis=1), 1.0)[:, None]
    shift = convolve1d(shift, SMOOTH, axis=0, mode="nearest")

    height = feet[1:, ..., 2].min(axis=2)
    error = np.clip(height, BELOW, ABOVE) - height
    wanted = _held((loaded * error).sum(axis=1) / np.maximum(loaded.sum(axis=1), 1.0), np.asarray(loaded.any(axis=1)))
    position = motion.root_position.copy()
    position[:, :2] -= np.cumsum(shift, axis=0) / motion.fps
    position[:, 2] += _settled(wanted, motion.fps)
    return replace(motion, root_position=position)


def _relieved(motion: Motion, height: Float) -> Motion:
    """The same with raised feet relieved of what they are said to carry, heights (T, 2)."""
    contacts = np.asarray(motion.contacts)
    raised = np.all(contacts, axis=1, keepdims=True) & (height - height[:, ::-1] > RAISED)
    if not raised.any():
        return motion
    wrenches = motion.wrenches
    if wrenches is not None:
        moved = np.where(raised[..., None], wrenches, 0.0)
        wrenches = wrenches - moved
        # Moments are about the centre of pressure: the other foot's own stays where it is.
        wrenches[..., :3] += moved[:, ::-1, :3]
    return replace(motion, contacts=contacts & ~raised, wrenches=wrenches)


def _feet(motion: Motion) -> Float:
    """Heel and toe of both feet, (T, 2, 2, 3) [m]."""
    human = forward(motion)
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
