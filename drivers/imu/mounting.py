"""Mounting of an inertial sensor in the torso, from gravity measured in two attitudes of the torso."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from flexmotion.configs.errors import DriverError
from flexmotion.spatial.gravity import GRAVITY

Float = NDArray[np.float64]

LEAST_LEAN = math.radians(15)
"""Smallest lean of the torso that determines the forward direction well enough [rad]."""

GRAVITY_SHARE = 0.1
"""Largest relative difference between a measured force and gravity; more: the robot moved, or the scale is wrong."""


def mounting(before: Rotation, upright: Float, leaning: Float) -> Rotation:
    """Rotation from the sensor's frame to the torso's.

    Upright, the specific force points along the torso's z. Leaned forward about the torso's y, it has a component
    along -x. The two directions determine the rotation.

    Args:
        before: the mounting with which both were measured.
        upright, leaning: specific force while the torso stood upright, and leaned forward, (3,) [m/s²].

    Raises `DriverError` if a force differs from gravity, or the lean is too small.
    """
    for name, force in (("upright", upright), ("leaning", leaning)):
        length = float(np.linalg.norm(force))
        if abs(length - GRAVITY) > GRAVITY_SHARE * GRAVITY:
            raise DriverError(f"IMU, {name}: measures {length:.2f} m/s² at rest, expected {GRAVITY:.2f}: was it moved?")
    z = upright / np.linalg.norm(upright)
    back = leaning / np.linalg.norm(leaning)
    lean = math.acos(float(np.clip(back @ z, -1.0, 1.0)))
    if lean < LEAST_LEAN:
        raise DriverError(
            f"IMU: leaned by {math.degrees(lean):.0f}° only, expected {math.degrees(LEAST_LEAN):.0f}° or more"
        )
    x = (back @ z) * z - back
    x /= np.linalg.norm(x)
    return Rotation.from_matrix(np.array([x, np.cross(z, x), z])) * before
