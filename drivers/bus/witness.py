"""`GoalWitness`: counts goals that leave for the servos outside of what these have told to be their limits.

It stands at the last place where a goal is still in the program: at the bytes for the port. What it holds them against
was read back from the servos, not taken from the robot file, so it shares nothing with the loop's command filter.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Float = NDArray[np.float64]
Slots = NDArray[np.int64]


class GoalWitness:
    """Limits of the m servos of a bus, in their own units, and how often a goal passed them.

    Attributes:
        violations: goals outside, one a servo and goal.
    """

    def __init__(self, m: int) -> None:
        self.violations = 0
        self._lower, self._upper = np.full(m, -np.inf), np.full(m, np.inf)
        self._current = np.full(m, np.inf)

    def limit(self, slot: int, lower: float, upper: float, current: float = np.inf) -> None:
        """What a servo told: least and greatest goal position, and greatest goal current, in its units."""
        self._lower[slot], self._upper[slot], self._current[slot] = lower, upper, current

    def see(self, slots: Slots, position: Float, current: Float | None = None) -> None:
        """Goals read off the bytes on their way to `slots`, (k,) each, in the servos' units."""
        outside = (position < self._lower[slots]) | (position > self._upper[slots])
        if current is not None:
            outside |= np.abs(current) > self._current[slots]
        self.violations += int(np.count_nonzero(outside))
