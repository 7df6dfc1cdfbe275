"""`Ticker`: periodic absolute deadlines on the monotonic clock."""

from __future__ import annotations

import time


class Ticker:
    """Wakes once per period; the deadlines do not drift.

    Args:
        period_s: period [s].

    Attributes:
        deadline_ns: deadline of the last wait (`time.perf_counter_ns`).
        late_ns: lateness of the last wake-up [ns].
        missed: number of deadlines that had passed before the last wait.
        skipped: number of those that had passed by a period or more; no wait wakes for them.
    """

    def __init__(self, period_s: float) -> None:
        self.period_ns = round(period_s * 1e9)
        self.deadline_ns = time.perf_counter_ns()
        self.late_ns = self.missed = self.skipped = 0

    def wait(self) -> None:
        """Sleep until the next deadline; return at once if it passed less than a period ago."""
        now = time.perf_counter_ns()
        self.deadline_ns += self.period_ns
        behind = now - self.deadline_ns
        self.skipped = max(behind // self.period_ns, 0)
        self.missed = self.skipped + (behind > 0)
        self.deadline_ns += self.skipped * self.period_ns
        if self.deadline_ns > now:
            time.sleep((self.deadline_ns - now) * 1e-9)
        self.late_ns = time.perf_counter_ns() - self.deadline_ns
