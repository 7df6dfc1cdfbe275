"""`PushSchedule`: the force of pushes at the torso over time."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from flexmotion.drivers.sim.options import Push, SimOptions

Float = NDArray[np.float64]


class PushSchedule:
    """The sum of all pushes. Each starts at the physics step nearest to its time and delivers exactly its impulse."""

    def __init__(self, options: SimOptions, rng: np.random.Generator) -> None:
        self._timestep = options.timestep
        self._random = options.random_pushes
        self._rng = rng
        self._pending = sorted(options.pushes, key=lambda push: push.at, reverse=True)
        self._active: list[tuple[int, Float]] = []  # last step (exclusive), force
        self._force = np.zeros(3)
        self._next_random = 1

    def force(self, step: int) -> Float | None:
        """Force in the world frame during physics step number `step`, (3,) [N]; None: no push."""
        self._start_due(step)
        if self._active:
            self._active = [(end, force) for end, force in self._active if end > step]
        if not self._active:
            return None
        self._force.fill(0.0)
        for _, force in self._active:
            self._force += force
        return self._force

    def add(self, push: Push) -> None:
        """Add a push to those that are still to come."""
        self._pending = sorted([*self._pending, push], key=lambda one: one.at, reverse=True)

    def _start_due(self, step: int) -> None:
        while self._pending and self._step_of(self._pending[-1].at) <= step:
            self._start(self._pending.pop(), step)
        if self._random is not None and self._step_of(self._next_random * self._random.every_s) <= step:
            self._next_random += 1
            angle = self._rng.uniform(-math.pi, math.pi)
            size = self._random.impulse
            impulse = (size * math.cos(angle), size * math.sin(angle), 0.0)
            self._start(Push(at=step * self._timestep, impulse=impulse, duration=self._random.duration), step)

    def _start(self, push: Push, step: int) -> None:
        steps = max(1, round(push.duration / self._timestep))
        self._active.append((step + steps, np.array(push.impulse) / (steps * self._timestep)))

    def _step_of(self, at: float) -> int:
        return round(at / self._timestep)
