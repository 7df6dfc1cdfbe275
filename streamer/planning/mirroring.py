"""`Mirroring`: the planner's side of a mirrored person: present time, and when a pose calls for a plan."""

from __future__ import annotations

import math
import time
from collections import deque

from flexmotion.streamer.control.tick_row import TickRow
from flexmotion.streamer.motion.mirror_source import MirrorSource

_SOON, _LATE = 0.5, 0.25
"""A pose is waited for that is expected within the first share of the time between two, and for no longer than the
second share beyond that. A plan takes about as long as from one pose to the next: begun on arrival it follows a pose
that is half that time younger (docs/decisions.md)."""
_REMEMBERED = 16
"""Poses from which the delay is taken after which they are seen here."""


class Mirroring:
    """Tells the source which moment its frames show, and the replanner when the person has moved on.

    Args:
        source: of the human.
        rate_hz: ticks a second.
        lockstep: time is counted in ticks, not by the clock.
    """

    def __init__(self, source: MirrorSource, rate_hz: float, *, lockstep: bool) -> None:
        self.source, self._rate_hz, self._lockstep = source, rate_hz, lockstep
        self._planned_s = self._seen_s = -1.0
        self._now_s = 0.0
        self._delays: deque[float] = deque(maxlen=_REMEMBERED)

    @property
    def wanted(self) -> bool:
        """Whether a person is there whom the robot does not follow yet."""
        return self.source.wanted

    @property
    def resting(self) -> bool:
        """Whether the robot follows nobody."""
        return self.source.resting

    @property
    def fresh(self) -> bool:
        """Whether a pose has come since the last plan, and no newer one is about to come."""
        return self.source.newest_s > self._planned_s and not self._another_soon

    @property
    def seen_ns(self) -> int:
        """Arrival of the newest frame that plans follow (`time.perf_counter_ns`); 0 in lockstep, and for nobody."""
        return 0 if self._lockstep or self.resting else round(self.source.newest_s * 1e9)

    def update(self, tick: int) -> None:
        """Take the poses that have come. `tick`: that the loop does next."""
        self._now_s = tick / self._rate_hz if self._lockstep else time.perf_counter()
        self.source.update(self._now_s)
        if self.source.newest_s > self._seen_s:
            self._seen_s = self.source.newest_s
            self._delays.append(self._now_s - self._seen_s)

    def align(self, row: TickRow, zero_tick: float) -> None:
        """Say at which tick frame 0 of the source is played; the newest `row` of the loop gives its time."""
        if self._lockstep:
            self.source.align(zero_tick / self._rate_hz)
        else:
            self.source.align(int(row.stamp_ns) * 1e-9 + (zero_tick - int(row.tick)) / self._rate_hz)

    def planned(self) -> None:
        """A plan with the newest pose was made."""
        self._planned_s = self.source.newest_s

    @property
    def _another_soon(self) -> bool:
        """Whether the next pose is worth waiting for."""
        between_s = self.source.between_s
        if not self._delays or not math.isfinite(between_s):
            return False
        # While a plan was made some were seen later than they could be.
        expected_s = self.source.newest_s + between_s + min(self._delays)
        return -_LATE * between_s < expected_s - self._now_s < _SOON * between_s
