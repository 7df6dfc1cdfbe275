"""Residual reduction: shift of the pelvis by millimetres so that ground forces explain the motion.

An error of the pelvis of 1 cm at 2 Hz is an acceleration of 1.6 m/s², a sixth of body weight. As in OpenSim's residual
reduction (Thelen & Anderson, J. Biomechanics 39(6), 2006) the least accurate part of the trajectory is adjusted; here
the path x of the whole body is shifted by δ(t):

    min  Σ |δ̈ + f/m|²  +  (2π f_low)⁴ Σ |δ|²

with the residual force f. Slow residuals (a hand on a rail, a step up) would need large shifts and remain.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solveh_banded

from flexmotion.human.motion import Motion

Float = NDArray[np.float64]

SLOWEST = 0.7
"""f_low: residuals slower than this remain [Hz]; a stride takes about a second."""

LARGEST = 0.02
"""Upper bound of the shift [m]."""

SECOND = np.array([1.0, -2.0, 1.0])


def shifted(motion: Motion, residual_force: Float) -> Motion:
    """The motion with its path shifted against residual forces (T, 3) [N]."""
    frames = len(motion)
    if frames < 4:
        return motion
    acceleration = residual_force / motion.body.mass
    band = np.zeros((3, frames))
    band[2] = (2 * np.pi * SLOWEST / motion.fps) ** 4
    right = np.zeros((frames, 3))
    for first, weight in enumerate(SECOND):
        right[first : frames - 2 + first] -= weight * acceleration[1:-1] / motion.fps**2
        for second in range(first, 3):
            band[2 - (second - first), second : frames - 2 + second] += weight * SECOND[second]
    shift = solveh_banded(band, right)
    size = np.linalg.norm(shift, axis=-1, keepdims=True)
    # tanh bounds the shift smoothly: a corner would be an impact.
    shift *= LARGEST * np.tanh(size / LARGEST) / np.maximum(size, 1e-12)
    return replace(motion, root_position=motion.root_position + shift)
