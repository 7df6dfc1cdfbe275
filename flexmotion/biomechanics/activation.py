"""First-order activation dynamics: bounds on muscle activation from one frame to the next.

    da/dt = (u - a) / τ,   τ = τ_rise (0.5 + 1.5 a) while u > a,   τ_fall / (0.5 + 1.5 a) else,   0 <= u <= 1

(Thelen, J. Biomech. Eng. 125, 2003; Millard et al., J. Biomech. Eng. 135, 2013), as in MuJoCo's muscles. Activation
rises fastest at excitation 1 and falls fastest at 0.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

Float = NDArray[np.float64]

SAMPLES = 513
SUBSTEPS = 200
GRID = np.linspace(0.0, 1.0, SAMPLES)


@dataclass(frozen=True)
class ActivationLimits:
    """Least and greatest activation in the next frame, tabulated over the present activation."""

    rise: Float
    fall: Float

    def bounds(self, activation: Float) -> tuple[Float, Float]:
        """Lower and upper bounds on the next activations, (M,) each."""
        return np.interp(activation, GRID, self.fall), np.interp(activation, GRID, self.rise)


@lru_cache(maxsize=16)
def activation_limits(step: float, rise_time: float, fall_time: float) -> ActivationLimits:
    """Limits over a time step, with time constants as in MuJoCo's `dynprm` [s]; midpoint rule, exact to 1e-4."""
    rise = GRID.copy()
    fall = rise.copy()
    dt = step / SUBSTEPS

    def rising(a: Float) -> Float:
        return (1.0 - a) / (rise_time * (0.5 + 1.5 * a))

    def falling(a: Float) -> Float:
        return -a * (0.5 + 1.5 * a) / fall_time

    for _ in range(SUBSTEPS):
        rise = rise + dt * rising(rise + dt / 2 * rising(rise))
        fall = fall + dt * falling(fall + dt / 2 * falling(fall))
    return ActivationLimits(rise, fall)
