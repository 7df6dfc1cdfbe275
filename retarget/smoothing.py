"""Filter that follows a target with jumps, within bounds on speed and acceleration."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

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

    def slowed(self, pace: float, whole: NDArray[np.bool_]) -> Follower:
        """The same filter for motion at a share of its pace: bounds as time is stretched by it.

        Args:
            whole: channels whose bounds stay, (C,): they follow a time of their own.
        """
        if pace >= 1.0:
            return self
        share = np.where(whole, 1.0, pace)
        return replace(self, speed=share * self.speed, acceleration=share**2 * self.acceleration)

    def passing(self, places: Float, channel: int) -> Float:
        """Targets for which a channel's positions are given ones, within its bounds, (T,).

        Args:
            places: positions after each row, and before them those of the two rows before the first, (T + 2,).
        """
        keep, pull = self._gains(self.omega[channel])
        speeds = np.diff(places) / self.dt
        targets: Float = places[1:-1] + (speeds[1:] - keep * speeds[:-1]) / pull
        return targets

    def _gains(self, omega: Any) -> tuple[Any, Any]:
        """Share of the speed that stays in a tick, and what a distance from the target adds to it [-, 1/s]."""
        # Implicit Euler of x'' = w² (r - x) - 2 w x': stable for any step.
        gain = omega**2 * self.dt
        divisor = 1.0 + 2.0 * omega * self.dt + gain * self.dt
        return 1.0 / divisor, gain / divisor

    def follow(self, targets: Float, position: Float, velocity: Float) -> tuple[Float, Float, Float, Float]:
        """Run over the rows of `targets` (T, C) from a position and velocity (C,).

        Returns:
            Positions and velocities after each row, (T, C) each, and whether the speed and the acceleration bound were
            active, (T, C) bool each.
        """
        rows = targets.shape
        positions, velocities, wishes, bounds = (np.empty(rows) for _ in range(4))
        keep, pull = self._gains(self.omega)
        reach, slowest = self.acceleration * self.dt, -self.speed
        x, v, part = position, velocity, np.empty(rows[1])
        # In place: thousands of calls on a dozen numbers, where each new array costs as much as the sum.
        for target, wish, bound, place, speed in zip(targets, wishes, bounds, positions, velocities, strict=True):
            np.subtract(target, x, out=part)
            part *= pull
            np.multiply(keep, v, out=wish)
            wish += part
            np.subtract(v, reach, out=part)
            np.maximum(wish, part, out=bound)
            np.add(v, reach, out=part)
            np.minimum(bound, part, out=bound)
            np.maximum(bound, slowest, out=speed)
            np.minimum(speed, self.speed, out=speed)
            np.multiply(speed, self.dt, out=place)
            place += x
            x, v = place, speed
        return positions, velocities, velocities != bounds, bounds != wishes
