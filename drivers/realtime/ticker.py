"""`Ticker`: absolute deadlines on the monotonic clock, which no change of the wall clock moves."""

from __future__ import annotations

import time


class Ticker:
    """Wakes once a period; the deadlines do not drift, whatever a period's work takes.

    Args:
        period_s: [s].

    Attributes:
        deadline_ns: of the period that was last waited for (`time.perf_counter_ns`).
        late_ns: how late the last wait woke [ns].
        missed: deadlines that had come before they were waited for, in the last wait.
        skipped: those of them that lie a period or more back: no wait will wake for them.
    """

    def __init__(self, period_s: float) -> None:
        self.period_ns = round(period_s * 1e9)
        self.deadline_ns = time.perf_counter_ns()
        self.late_ns = self.missed = self.skipped = 0

    def wait(self) -> None:
        """Sleep until the next deadline; one that came less than a period ago is taken at once."""
        now = time.perf_counter_ns()
        self.deadline_ns += self.period_ns
        behind = now - self.deadline_ns
        self.skipped = max(behind // self.period_ns, 0)
        self.missed = self.skipped + (behind > 0)
        self.deadline_ns += self.skipped * self.period_ns
        if self.deadline_ns > now:
            time.sleep((self.deadline_ns - now) * 1e-9)
        self.late_ns = time.perf_counter_ns() - self.deadline_ns
