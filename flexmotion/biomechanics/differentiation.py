"""Derivatives of uniformly sampled signals by central differences of sixth order.

At 6 Hz and 30 frames per second (a fifth of the rate) the second derivative is 0.6 % low; the usual three-point
formula would be 12 % low.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Float = NDArray[np.float64]

FIRST = np.array([-1.0, 9.0, -45.0, 0.0, 45.0, -9.0, 1.0]) / 60.0
SECOND = np.array([2.0, -27.0, 270.0, -490.0, 270.0, -27.0, 2.0]) / 180.0
"""Weights of seven samples around the middle one, for a step of 1 (Fornberg, Math. Comp. 51(184), 1988)."""

HALF = len(FIRST) // 2
EDGE = 2 * HALF
"""Frames at each end of a motion whose rates of momentum would need frames beyond it."""


def derivative(signal: Float, fps: float) -> Float:
    """First derivative over the first axis, (T, ...) -> (T, ...) [signal/s]."""
    return _apply(FIRST, signal) * fps


def second_derivative(signal: Float, fps: float) -> Float:
    """Second derivative over the first axis, (T, ...) -> (T, ...) [signal/s²]."""
    return _apply(SECOND, signal) * fps**2


def _apply(weights: Float, signal: Float) -> Float:
    """Weighted sum of seven neighbours; beyond its ends the signal goes on with constant acceleration."""
    frames = len(signal)
    if frames < 3:
        signal = np.concatenate([signal, np.repeat(signal[-1:], 3 - frames, axis=0)])
    padded = np.concatenate([_onwards(signal[:3][::-1])[::-1], signal, _onwards(signal[-3:])])
    total = np.zeros_like(signal[:frames])
    for offset, weight in enumerate(weights):
        if weight:
            total += weight * padded[offset : offset + frames]
    return total


def _onwards(last: Float) -> Float:
    """The next samples of the parabola through three, (3, ...) -> (HALF, ...)."""
    steps = np.arange(1, HALF + 1).reshape(-1, *[1] * (last.ndim - 1))
    velocity, bend = last[2] - last[1], last[2] - 2 * last[1] + last[0]
    return last[2] + steps * velocity + steps * (steps + 1) / 2 * bend
