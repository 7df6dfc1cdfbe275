"""Filter that follows a target with jumps, within bounds on speed and acceleration."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexmotion.human.filters import recursive

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
        positions, velocities = self._unbounded(targets, position, velocity)
        before = np.concatenate([velocity[None], velocities[:-1]])
        slow = np.abs(velocities) > self.speed
        soft = np.abs(velocities - before) > self.acceleration * self.dt
        # Most channels of most plans meet no bound; the others run row by row from the first one on.
        for channel in map(int, np.flatnonzero((slow | soft).any(axis=0))):
            row = int((slow | soft)[:, channel].argmax())
            x = positions[row - 1, channel] if row else position[channel]
            line = self._bounded(targets[row:, channel], channel, float(x), float(before[row, channel]))
            for array, values in zip((positions, velocities, slow, soft), line, strict=True):
                array[row:, channel] = values
        return positions, velocities, slow, soft

    def _unbounded(self, targets: Float, position: Float, velocity: Float) -> tuple[Float, Float]:
        """Positions and velocities of `follow` where no bound is met, (T, C) each.

        Of positions alone it is the linear filter x_k = (1 + keep - pull) x_k-1 - keep x_k-2 + pull r_k.
        """
        positions = np.empty(targets.shape)
        for omega, own in self._alike:
            keep, pull = self._gains(omega)
            pull = float(pull * self.dt)
            start, last = position[own], keep * (position[own] - self.dt * velocity[own])
            state = np.stack([(1.0 + keep - pull) * start - last, -keep * start])
            positions[:, own] = recursive([pull], [pull - keep - 1.0, keep], targets[:, own], state)
        moved = np.concatenate([position[None], positions])
        return positions, (moved[1:] - moved[:-1]) / self.dt

    @cached_property
    def _alike(self) -> list[tuple[float, slice]]:
        """Natural frequencies, and the channels next to each other that have them."""
        edges = [0, *(np.flatnonzero(self.omega[1:] != self.omega[:-1]) + 1).tolist(), len(self.omega)]
        return [(float(self.omega[a]), slice(a, b)) for a, b in zip(edges[:-1], edges[1:], strict=True)]

    def _bounded(
        self, targets: Float, channel: int, x: float, v: float
    ) -> tuple[list[float], list[float], list[bool], list[bool]]:
        """What `follow` returns for one channel, (T,) each.

        Args:
            targets: (T,); x, v: position and velocity before the first row.
        """
        keep, pull = map(float, self._gains(self.omega[channel]))
        reach, fastest, dt = float(self.acceleration[channel]) * self.dt, float(self.speed[channel]), self.dt
        positions, velocities, slow, soft = list[float](), list[float](), list[bool](), list[bool]()
        # Plain numbers: numpy takes ten times as long for one at a time.
        for target in targets.tolist():
            wish = keep * v + pull * (target - x)
            low, high = v - reach, v + reach
            bound = low if wish < low else high if wish > high else wish
            v = -fastest if bound < -fastest else fastest if bound > fastest else bound
            x += v * dt
            positions.append(x)
            velocities.append(v)
            slow.append(v != bound)
            soft.append(bound != wish)
        return positions, velocities, slow, soft
