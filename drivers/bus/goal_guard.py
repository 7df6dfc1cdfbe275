"""`GoalGuard`: replaces goals outside their envelope before they are sent, and counts them (docs/faults.md).

It checks goals decoded from the bytes for the port, the last point in the program. It shares no code with the loop's
command filter.
"""

from __future__ import annotations

from collections.abc import Sequence
from operator import ge, le

import numpy as np
from numpy.typing import NDArray

Float = NDArray[np.float64]
Slots = NDArray[np.int64]

PIN_TICKS = 1
"""Allowed distance of a pinned goal from the position of its joint [servo units]."""


class GoalGuard:
    """The envelope of goals of the m servos of a bus, in servo units.

    Args:
        lower, upper: the joints' limits, (m,).

    Attributes:
        violations: goals outside, counted per servo and goal.
    """

    def __init__(self, lower: Float, upper: Float) -> None:
        self.violations = 0
        self._joint_lower, self._joint_upper = lower.copy(), upper.copy()
        m = len(lower)
        self._lower, self._upper = np.full(m, -np.inf), np.full(m, np.inf)
        self._current = np.full(m, np.inf)
        self._last = np.full(m, np.nan)
        # Least and greatest goal position and greatest goal current that are inside whatever the goal before was, and
        # goals that are not yet in `_last`, by the slots that they are for.
        self._inner: dict[tuple[int, ...], tuple[list[float], list[float], list[float]]] = {}
        self._newest: dict[tuple[int, ...], Sequence[float]] = {}

    @property
    def last(self) -> Float:
        """Goal positions that were admitted last, (m,) [servo units]; NaN: none yet."""
        for slots, position in self._newest.items():
            self._last[list(slots)] = position
        self._newest.clear()
        return self._last

    def limit(self, slot: int, lower: float, upper: float, current: float = np.inf) -> None:
        """Set a servo's own limits: least and greatest goal position, and greatest goal current [servo units]."""
        self._lower[slot], self._upper[slot], self._current[slot] = lower, upper, current
        self._inner.clear()

    def admits(self, slots: tuple[int, ...], position: Sequence[float], current: Sequence[float] = ()) -> bool:
        """Whether all goals are inside the joints' limits and the servos' own, as in nearly every tick.

        `admit` would return them unchanged, and count none; they are admitted by this call, which takes a tenth of its
        time. If not, nothing has happened and `admit` is to be called.

        Args:
            slots: servos, k.
            position: goals decoded from the bytes to send, k [servo units].
            current: goal currents, k or none [servo units].
        """
        inner = self._inner.get(slots)
        if inner is None:
            which = list(slots)
            lower = np.maximum(self._joint_lower, self._lower)[which].tolist()
            upper = np.minimum(self._joint_upper, self._upper)[which].tolist()
            inner = self._inner[slots] = lower, upper, self._current[which].tolist()
        lower, upper, most = inner
        if not (all(map(le, lower, position)) and all(map(ge, upper, position))):
            return False
        if current and not all(map(ge, most, map(abs, current))):
            return False
        self._newest[slots] = position
        return True

    def admit(
        self, slots: Slots, position: Float, current: Float | None = None, standing: Float | None = None
    ) -> Float:
        """Check goals for the servos in `slots`, decoded from the bytes to send, (k,) each [servo units].

        A goal must be within the joint's limits, or no further outside than the goal before it. A pinned goal may be as
        far outside as its joint: `standing` is the joint's position for pinned goals, NaN for the others. Every goal
        must be within the servo's own limits.

        Returns:
            Goals to send, (k,). A goal outside is replaced by the one before it; the first one by the nearest inside.
        """
        last = self.last[slots]
        lower = np.fmin(self._joint_lower[slots], last)
        upper = np.fmax(self._joint_upper[slots], last)
        if standing is not None:
            lower, upper = np.fmin(lower, standing - PIN_TICKS), np.fmax(upper, standing + PIN_TICKS)
        lower, upper = np.fmax(lower, self._lower[slots]), np.fmin(upper, self._upper[slots])
        outside = (position < lower) | (position > upper)
        kept = np.where(np.isnan(last), np.clip(position, lower, upper), last)
        admitted = self._last[slots] = np.where(outside, kept, position)
        if current is not None:
            outside |= np.abs(current) > self._current[slots]
        self.violations += int(np.count_nonzero(outside))
        return admitted

    def nearest(self, position: Float) -> Float:
        """The goals inside the envelope nearest to `position`, (m,)."""
        lower, upper = np.fmin(self._joint_lower, self.last), np.fmax(self._joint_upper, self.last)
        return np.clip(position, np.fmax(lower, self._lower), np.fmin(upper, self._upper))
