"""`Punctuality`: recent lateness of the loop itself, which may be why a servo seems not to answer."""

from __future__ import annotations

import numpy as np

from flexmotion.configs.robot import Robot

_RELEVANT = 0.5
"""Lateness that may be the cause of a missed answer, in ticks: the time that a read of the servos may take."""


class Punctuality:
    """Keeps the lateness of the last ticks: twice as many as a servo may be silent for."""

    def __init__(self, robot: Robot) -> None:
        self._period = 1.0 / robot.rate_hz
        self._late = np.zeros(2 * (robot.safety.max_stale_reads + 1))
        self._next_tick = 0

    def woke(self, tick: int, late_s: float, waited_s: float = 0.0) -> None:
        """Record that a tick begins; ticks that were skipped before it count as lateness.

        Args:
            tick: its number.
            late_s: how late it begins [s].
            waited_s: time that the tick before waited for servos to be switched on, which is no lateness [s].
        """
        skipped = max(tick - self._next_tick, 0) if self._next_tick else 0
        late = late_s + skipped * self._period - max(waited_s - self._period, 0.0)
        self._late[tick % len(self._late)] = max(late, 0.0)
        self._next_tick = tick + 1

    @property
    def remark(self) -> str:
        """Addition to a message that something did not answer; empty while the loop was on time."""
        worst = float(self._late.max())
        if worst < _RELEVANT * self._period:
            return ""
        return f" (the loop itself woke {1e3 * worst:.0f} ms late: this machine was busy with something else)"
