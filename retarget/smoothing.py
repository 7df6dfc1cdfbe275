"""Smooth following of a target that may jump, within limits on speed and acceleration."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Float = NDArray[np.float64]


@dataclass(frozen=True)
class Follower:
    """A critically damped second-order filter a channel, with bounded speed and acceleration.

    It lags a moving target by 2 / omega seconds; who knows the target ahead of time shows it that much earlier.

    Attributes:
        omega: natural frequency a channel, (C,) [1/s].
        speed, acceleration: bounds a channel, (C,) [unit/s, unit/s²].
        dt: time a tick [s].
    """

    omega: Float
    speed: Float
    acceleration: Float
    dt: float

    def follow(self, targets: Float, position: Float, velocity: Float) -> tuple[Float, Float, Float, Float]:
        """Run over the rows of `targets` (T, C) from a position and velocity (C,).

        Returns:
            Positions and velocities (T, C) after each row, and whether the speed and the acceleration bound held
            the channel back, each (T, C) bool.
        """
        rows = targets.shape
        positions, velocities = np.empty(rows), np.empty(rows)
        slow, soft = np.empty(rows, np.bool_), np.empty(rows, np.bool_)
        # Implicit Euler of x'' = w² (r - x) - 2 w x': stable for any step.
        gain = self.omega**2
        divisor = 1.0 + 2.0 * self.omega * self.dt + gain * self.dt**2
        x, v = position.copy(), velocity.copy()
        reach = self.acceleration * self.dt
        for k in range(len(targets)):
            wish = (v + self.dt * gain * (targets[k] - x)) / divisor
            bounded = np.minimum(np.maximum(wish, v - reach), v + reach)
            slowed = np.minimum(np.maximum(bounded, -self.speed), self.speed)
            soft[k] = bounded != wish
            slow[k] = slowed != bounded
            v = slowed
            x = x + self.dt * v
            positions[k], velocities[k] = x, v
        return positions, velocities, slow, soft
