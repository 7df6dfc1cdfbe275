"""`Revisions`: which plans know of which changes of what holds beside the target for the whole body."""

from __future__ import annotations

import math

_BETWEEN_S = 0.1
"""Least time between two plans that are made for such changes alone [s]: a hand that is dragged sends many."""


class Revisions:
    """Counts changes, and remembers the newest one that each plan knows.

    Args:
        rate_hz: ticks a second.

    Attributes:
        newest: number of the last change; 0: none yet.
    """

    def __init__(self, rate_hz: float) -> None:
        self.newest = 0
        self._between = _BETWEEN_S * rate_hz
        self._made: dict[int, int] = {}  # newest change by plan
        self._planned_tick = -math.inf

    def change(self) -> int:
        """Something has changed; returns the number of this change."""
        self.newest += 1
        return self.newest

    def known(self, *plans: int) -> int:
        """The newest change that one of these plans knows."""
        return max(self._made.get(plan, 0) for plan in plans)

    def wants(self, plan: int, tick: int) -> bool:
        """Whether a plan is due at a tick because the one with this id does not know all changes."""
        return self.known(plan) != self.newest and tick >= self._planned_tick + self._between

    def made(self, plan: int, playing: int, tick: int) -> None:
        """A plan was made that knows all changes.

        Args:
            plan: its id; playing: id of the plan that plays.
            tick: that the loop does next.
        """
        if self.newest not in self._made.values():
            self._planned_tick = tick
        self._made[plan] = self.newest
        self._made = {key: value for key, value in self._made.items() if key >= playing}
