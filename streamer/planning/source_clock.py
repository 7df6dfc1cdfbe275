"""`SourceClock`: time of the human at the loop's rows, also while a robot rests and no plan follows the human."""

from __future__ import annotations

import math

from flexmotion.streamer.control.tick_row import TickRow


class SourceClock:
    """Args: ticks a second."""

    def __init__(self, rate_hz: float) -> None:
        self._rate_hz = rate_hz
        self._second, self._tick = math.nan, 0

    def second(self, row: TickRow, *, runs_on: bool) -> float:
        """Source time of a row [s]; NaN where none is known.

        Args:
            runs_on: the time goes on by ticks where the row follows no human.
        """
        second, tick = float(row.source_s), int(row.tick)
        if math.isfinite(second):
            self._second, self._tick = second, tick
        elif runs_on:
            second = self._second + (tick - self._tick) / self._rate_hz
        return second
