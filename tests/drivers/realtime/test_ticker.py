"""Absolute deadlines, on a simulated clock."""

from __future__ import annotations

import time

import pytest

from flexmotion.drivers.realtime.ticker import Ticker

MS = 1_000_000


class Clock:
    """Time that passes only in `sleep` and by a test."""

    def __init__(self) -> None:
        self.now_ns = 5 * MS
        self.oversleep_ns = 0

    def perf_counter_ns(self) -> int:
        return self.now_ns

    def sleep(self, seconds: float) -> None:
        self.now_ns += round(seconds * 1e9) + self.oversleep_ns


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    made = Clock()
    monkeypatch.setattr(time, "perf_counter_ns", made.perf_counter_ns)
    monkeypatch.setattr(time, "sleep", made.sleep)
    return made


def test_deadlines_do_not_drift(clock: Clock) -> None:
    ticker, begin = Ticker(0.008), clock.now_ns
    for k in range(1, 100):
        clock.now_ns += k % 7 * MS  # work
        clock.oversleep_ns = k % 3 * 50_000
        ticker.wait()
        assert ticker.deadline_ns == begin + 8 * k * MS
        assert ticker.late_ns == clock.oversleep_ns and ticker.missed == 0


def test_work_longer_than_a_period_misses_a_deadline_and_continues_at_once(clock: Clock) -> None:
    ticker = Ticker(0.008)
    ticker.wait()
    clock.now_ns += 11 * MS
    ticker.wait()
    assert (ticker.missed, ticker.skipped, ticker.late_ns) == (1, 0, 3 * MS)
    ticker.wait()  # back on the grid
    assert (ticker.missed, ticker.late_ns) == (0, 0)


def test_missed_whole_periods_are_skipped(clock: Clock) -> None:
    ticker, begin = Ticker(0.008), clock.now_ns
    ticker.wait()
    clock.now_ns += 35 * MS
    ticker.wait()
    assert (ticker.missed, ticker.skipped) == (4, 3)
    assert ticker.deadline_ns == begin + 5 * 8 * MS and ticker.late_ns == 3 * MS
