"""How a torso is tilted, and whether it is tilted further than it was to be: then the robot falls.

Upright robots fall once they are tilted by a given angle. One that bows is tilted on purpose: it falls where it is
tilted further than its plan. It lags behind its plan, so tilts between upright and the plan are no falls.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Float = NDArray[np.float64]

PAST_PLAN_RAD = 0.2
"""Tilt beyond a planned tilt that is itself as far as that of a fall, from which on a robot falls [rad]. In bows of
66° perturbed OP3 that are pushed come .08 beyond their plans, frozen ones .14 (`benchmarks/robot/bows.py`)."""


def lean_of(quaternion: Float) -> Float:
    """The tilts of bodies, whatever they are turned to.

    Args:
        quaternion: unit quaternions w x y z, (..., 4); NaN stays.

    Returns:
        The angle between the body's up axis and the world's, ahead and to the left as the body leans, (..., 2) [rad].
    """
    w, x, y, z = (quaternion[..., part] for part in range(4))
    # The world's up axis in the body's frame, which points back where the body leans ahead.
    level = np.stack([2.0 * (w * y - x * z), -2.0 * (y * z + w * x)], axis=-1)
    return _lean(level, 1.0 - 2.0 * (x * x + y * y))


def tilt_of(quaternion: Float) -> Float:
    """Angle between a body's up axis and the world's, (...) [rad], by unit quaternions w x y z (..., 4); NaN stays."""
    lean = lean_of(quaternion)
    found: Float = np.hypot(lean[..., 0], lean[..., 1])
    return found


def lean_of_angles(roll: float, pitch: float) -> Float:
    """The same of roll and pitch (z-y-x order) [rad], (2,)."""
    level = np.array([np.sin(pitch), -np.cos(pitch) * np.sin(roll)])
    return _lean(level, np.cos(pitch) * np.cos(roll))


def _lean(level: Float, up: Float) -> Float:
    sine = np.hypot(level[..., 0], level[..., 1])
    found: Float = level * (np.arctan2(sine, up) / np.maximum(sine, 1e-9))[..., None]
    return found


def falls(lean: Float, planned: Float, fall_tilt: float) -> NDArray[np.bool_]:
    """Whether torsos are tilted as none is that stands, or is on its way between upright and its plan.

    Allowed is the convex hull of two discs: of `fall_tilt` about upright, and of `PAST_PLAN_RAD` about the plan.

    Args:
        lean: measured, (..., 2) [rad]; NaN does not fall.
        planned: likewise, (..., 2) [rad]; one that is unknown (NaN) is upright.
        fall_tilt: tilt that is a fall of a robot that is to be upright [rad].
    """
    planned = np.where(np.isfinite(planned), planned, 0.0)
    far = np.hypot(planned[..., 0], planned[..., 1])
    way = planned / np.maximum(far, 1e-9)[..., None]
    along = np.sum(lean * way, axis=-1)
    across = np.abs(lean[..., 0] * way[..., 1] - lean[..., 1] * way[..., 0])
    # The disc of the hull that is nearest: radii shrink by `slope` a radian of the way from upright to the plan.
    wider = max(fall_tilt - PAST_PLAN_RAD, 0.0)
    slope = np.minimum(wider / np.maximum(far, 1e-9), 1.0)
    # A plan whose disc lies in the other one allows no more.
    back = across * slope / np.sqrt(np.maximum(1.0 - slope * slope, 1e-12))
    place = np.where(far > wider, np.clip(along - back, 0.0, far), 0.0)
    away = lean - place[..., None] * way
    found: NDArray[np.bool_] = np.hypot(away[..., 0], away[..., 1]) > fall_tilt - slope * place
    return found
