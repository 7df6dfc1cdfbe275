"""Filter that follows a target with jumps, within bounds on speed and acceleration."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexmotion.compiled import FLOAT, FLOATS, compiled

Float = NDArray[np.float64]
Bool = NDArray[np.bool_]


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

    def follow(self, targets: Float, position: Float, velocity: Float) -> tuple[Float, Float, Bool, Bool]:
        """Run over the rows of `targets` (T, C) from a position and velocity (C,).

        Returns:
            Positions and velocities after each row, (T, C) each, and whether the speed and the acceleration bound were
            active, (T, C) bool each.
        """
        if not targets.shape[1] == len(position) == len(velocity) == len(self.omega):
            raise ValueError(f"{len(self.omega)} channels, found targets {targets.shape} from {position.shape}")
        keep, pull = self._gains(self.omega)
        return _follow(targets, position, velocity, keep, pull, self.speed, self.acceleration, self.dt)


@compiled(FLOATS[2], *[FLOATS[1]] * 6, FLOAT)
def _follow(
    targets: Float,
    position: Float,
    velocity: Float,
    keep: Float,
    pull: Float,
    speed: Float,
    acceleration: Float,
    dt: float,
) -> tuple[Float, Float, Bool, Bool]:
    """`Follower.follow`; keep, pull: gains of each channel, (C,)."""
    positions, velocities = np.empty_like(targets), np.empty_like(targets)
    slow, soft = np.empty(targets.shape, np.bool_), np.empty(targets.shape, np.bool_)
    for channel in range(targets.shape[1]):
        x, v = position[channel], velocity[channel]
        reach, fastest = acceleration[channel] * dt, speed[channel]
        for row in range(len(targets)):
            wish = keep[channel] * v + pull[channel] * (targets[row, channel] - x)
            bound = min(max(wish, v - reach), v + reach)
            v = min(max(bound, -fastest), fastest)
            x += v * dt
            positions[row, channel], velocities[row, channel] = x, v
            # Written so that a number that is none meets no bound.
            slow[row, channel], soft[row, channel] = abs(v - bound) > 0.0, abs(bound - wish) > 0.0
    return positions, velocities, slow, soft
