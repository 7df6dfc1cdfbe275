"""`kept`: feet of a body that stays where it is do not slide over the floor.

People of the data bow, say goodbye or squat with feet in one place, each in a stance of their own. A model that begins
from another stance lets feet that carry load slide there, apart by as much as .3 m. A root that moves makes up for what
both feet have in common (`planted.Slip`), the legs for the rest.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import convolve1d

from flexmotion.biomechanics.differentiation import derivative
from flexmotion.biomechanics.sole import NEARNESS

Float = NDArray[np.float64]
Flags = NDArray[np.bool_]

LIFTED = 0.1
"""A foot that is said to carry load does, up to this height of the lower of heel and toe [m]: planting leaves feet that
disagree centimetres above the floor."""
SWINGS = 1.0
"""A foot near the floor without load that is faster than this makes a step [m/s]."""
RETURNS_S = 0.1
"""Time constant with which a foot that has lifted comes back to its own path."""
FARTHEST = 0.3
"""A foot that would have to be kept back farther than this slides [m]."""
SMOOTH = np.array([0.25, 0.5, 0.25])
"""Filter over frames."""


def resting(feet: Float, contacts: Flags, fps: float) -> Flags:
    """Feet that rest, whatever their speed where they carry load, (T, 2).

    Args:
        feet: heel and toe of both feet in the frame before, then in each frame, (T + 1, 2, 2, 3) [m].
        contacts: feet that carry load, (T, 2).
        fps: frames per second.
    """
    height = feet[1:, ..., 2].min(axis=2)
    speed = np.linalg.norm(derivative(_places(feet), fps)[1:], axis=-1)
    return np.asarray((height < np.where(contacts, LIFTED, NEARNESS.height)) & (contacts | (speed < SWINGS)))


def kept(feet: Float, rests: Flags, fps: float) -> Float:
    """How far each foot is moved to stay where it rests, on the floor, (T, 2, 2) [m].

    A foot that rests before the first frame stays there; one that comes to rest stays where it does.

    Args:
        feet, fps: see `resting`.
        rests: its result.
    """
    back = float(np.exp(-1.0 / (RETURNS_S * fps)))
    moved, steps = np.zeros((len(feet), 2, 2)), np.diff(_places(feet), axis=0)
    for foot in range(2):
        # Plain numbers: arrays of two of them take several times as long.
        x, y, path = 0.0, 0.0, []
        for (ahead, aside), still in zip(steps[:, foot].tolist(), rests[:, foot].tolist(), strict=True):
            x, y = (x - ahead, y - aside) if still else (back * x, back * y)
            path.append((x, y))
        moved[1:, foot] = path
    far = np.hypot(moved[..., :1], moved[..., 1:]) / FARTHEST
    smooth: Float = convolve1d(moved / np.maximum(far, 1.0), SMOOTH, axis=0, mode="nearest")
    return smooth[1:]


def _places(feet: Float) -> Float:
    """Middles of heel and toe on the floor, (T + 1, 2, 2) [m]."""
    found: Float = feet[..., :2].mean(axis=2)
    return found
