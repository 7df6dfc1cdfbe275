"""`Repetitions`: how often a gesture was made. Planner and benchmarks count with it."""

from __future__ import annotations

_SEEN = 1.0
"""Way from the lowest since the last repetition that a new one takes (unit of `GestureWay`)."""
_RETURN = 0.7
"""Share of its way by which it comes back. Hands of the simulated OP3 dipped by up to .58 of it while they waved or
stayed up, and came back by .78 and more between two gestures (11 gestures, two seeds)."""


class Repetitions:
    """Counts by the way of the parts that move (`gesture_way.py`).

    Once is away from the stand and back: a hand that goes up, waves to and fro, and comes down has waved once; a trunk
    that goes down and up has bowed once. What is done meanwhile, the strokes of a waving hand, does not count.

    Attributes:
        begun: repetitions that have begun.
        done: those of them that have come back.
    """

    def __init__(self) -> None:
        self.begun = self.done = 0
        self._lowest, self._highest = float("inf"), 0.0

    @property
    def away(self) -> bool:
        """Whether one is under way."""
        return self.begun > self.done

    def update(self, way: float) -> None:
        """Take the next way."""
        if self.away:
            self._highest = max(self._highest, way)
            if self._highest - way >= _RETURN * (self._highest - self._lowest):
                self.done, self._lowest = self.done + 1, way
        else:
            self._lowest = min(self._lowest, way)
            if way - self._lowest >= _SEEN:
                self.begun, self._highest = self.begun + 1, way
