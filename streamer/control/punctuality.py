"""How late the loop itself was of late: what did not answer in time may have been this machine."""

from __future__ import annotations

import numpy as np

from flexmotion.configs.robot import Robot

_WORTH_TELLING = 0.5
"""Lateness from which on it may be the cause, in ticks: what a read of the servos may take."""


class Punctuality:
    """Remembers how late the last ticks began, as many as it takes to give a servo up, and as many before."""

    def __init__(self, robot: Robot) -> None:
        self._period = 1.0 / robot.rate_hz
        self._late = np.zeros(2 * (robot.safety.max_stale_reads + 1))
        self._next_tick = 0

    def woke(self, tick: int, late_s: float, waited_s: float = 0.0) -> None:
        """A tick begins so late [s]; ticks that were left out since the last one were slept through.

        Args:
            waited_s: for how long the tick before waited for servos to be switched on, which is not the machine's [s].
        """
        skipped = max(tick - self._next_tick, 0) if self._next_tick else 0
        late = late_s + skipped * self._period - max(waited_s - self._period, 0.0)
        self._late[tick % len(self._late)] = max(late, 0.0)
        self._next_tick = tick + 1

    @property
    def remark(self) -> str:
        """For a message that something did not answer; empty while the loop was on time."""
        worst = float(self._late.max())
        if worst < _WORTH_TELLING * self._period:
            return ""
        return f" (the loop itself woke {1e3 * worst:.0f} ms late: this machine was busy with something else)"
