"""`GoalGuard`: keeps goals outside of their envelope from leaving for the servos, and counts them (docs/faults.md).

It stands at the last place where a goal is still in the program: at the bytes for the port. It shares nothing with the
loop's command filter.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Float = NDArray[np.float64]
Slots = NDArray[np.int64]

PIN_TICKS = 1
"""How far a goal that is pinned to where a joint stands may be from there [servo units]."""


class GoalGuard:
    """What the m servos of a bus may be told, in their own units, and how often a goal was something else.

    Args:
        lower, upper: the joints' limits, (m,).

    Attributes:
        violations: goals that were outside, one a servo and goal.
    """

    def __init__(self, lower: Float, upper: Float) -> None:
        self.violations = 0
        self._joint_lower, self._joint_upper = lower.copy(), upper.copy()
        m = len(lower)
        self._lower, self._upper = np.full(m, -np.inf), np.full(m, np.inf)
        self._current = np.full(m, np.inf)
        self._last = np.full(m, np.nan)

    def limit(self, slot: int, lower: float, upper: float, current: float = np.inf) -> None:
        """What a servo told: least and greatest goal position, and greatest goal current, in its units."""
        self._lower[slot], self._upper[slot], self._current[slot] = lower, upper, current

    def admit(
        self, slots: Slots, position: Float, current: Float | None = None, standing: Float | None = None
    ) -> Float:
        """Goals read off the bytes on their way to `slots`, (k,) each, in the servos' units.

        A goal is inside the joint's limits, or no further out than the one before it; `standing` is where the joints
        of goals that are pinned stand (NaN for the others), and these may be as far out as that. What a servo told
        holds for every goal.

        Returns:
            What may go, (k,): for a goal outside, the one before it; for a first one, the nearest that is inside.
        """
        lower = np.fmin(self._joint_lower[slots], self._last[slots])
        upper = np.fmax(self._joint_upper[slots], self._last[slots])
        if standing is not None:
            lower, upper = np.fmin(lower, standing - PIN_TICKS), np.fmax(upper, standing + PIN_TICKS)
        lower, upper = np.fmax(lower, self._lower[slots]), np.fmin(upper, self._upper[slots])
        outside = (position < lower) | (position > upper)
        last = self._last[slots]
        kept = np.where(np.isnan(last), np.clip(position, lower, upper), last)
        admitted = self._last[slots] = np.where(outside, kept, position)
        if current is not None:
            outside |= np.abs(current) > self._current[slots]
        self.violations += int(np.count_nonzero(outside))
        return admitted

    def nearest(self, position: Float) -> Float:
        """The goals nearest to `position` that may go, (m,) each."""
        lower, upper = np.fmin(self._joint_lower, self._last), np.fmax(self._joint_upper, self._last)
        return np.clip(position, np.fmax(lower, self._lower), np.fmin(upper, self._upper))
