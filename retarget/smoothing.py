"""Filter that follows a target with jumps, within bounds on speed and acceleration."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Float = NDArray[np.float64]


@dataclass(frozen=True)
class Follower:
    """A critically damped second-order filter for each channel, with bounded speed and acceleration.

    It lags a moving target by 2 / omega seconds; a target that is known ahead of time is given that much earlier.

    Attributes:
        omega: natural frequency of each channel, (C,) [1/s].
        speed, acceleration: bounds of each channel, (C,) [unit/s, unit/s²].
        dt: time a tick [s].
    """

    omega: Float
    speed: Float
    acceleration: Float
    dt: float

    def follow(self, targets: Float, position: Float, velocity: Float) -> tuple[Float, Float, Float, Float]:
        """Run over the rows of `targets` (T, C) from a position and velocity (C,).

        Returns:
            Positions and velocities after each row, (T, C) each, and whether the speed and the acceleration bound were
            active, (T, C) bool each.
        """
        rows = targets.shape
        positions, velocities, wishes, bounds = (np.empty(rows) for _ in range(4))
        # Implicit Euler of x'' = w² (r - x) - 2 w x': stable for any step.
        gain = self.omega**2 * self.dt
        divisor = 1.0 + 2.0 * self.omega * self.dt + gain * self.dt
        keep, pull = 1.0 / divisor, gain / divisor
        reach = self.acceleration * self.dt
        x, v = position, velocity
        for k, target in enumerate(targets):
            wish = keep * v + pull * (target - x)
            bounded = np.minimum(np.maximum(wish, v - reach), v + reach)
            v = np.minimum(np.maximum(bounded, -self.speed), self.speed)
            x = x + self.dt * v
            wishes[k], bounds[k], positions[k], velocities[k] = wish, bounded, x, v
        return positions, velocities, velocities != bounds, bounds != wishes
