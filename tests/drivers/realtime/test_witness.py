"""Timer processes that report when the machine itself stood still, or was slow."""

from __future__ import annotations

import os
import signal
import time
from multiprocessing.process import BaseProcess
from typing import Any

import numpy as np
import psutil
import pytest
from hypothesis import given
from hypothesis import strategies as st

from flexmotion.drivers.realtime import child
from flexmotion.drivers.realtime.priority import WITNESS_PRIORITY
from flexmotion.drivers.realtime.witness import Slowness, Witness, common, covered

from ...waiting import wait_until

pytestmark = pytest.mark.wall_clock

PERIOD_NS = 2_000_000

_spans = st.lists(st.tuples(st.integers(0, 60), st.integers(0, 20)), max_size=6)


@given(intervals=_spans, moments=_spans)
def test_how_much_of_an_interval_a_standstill_covers(
    intervals: list[tuple[int, int]], moments: list[tuple[int, int]]
) -> None:
    spans = np.array([(begin, begin + length) for begin, length in intervals], np.int64).reshape(-1, 2)
    told = np.array(sorted((begin, begin + length + 1) for begin, length in moments), np.int64).reshape(-1, 2)
    expected = [sum(any(begin <= t < end for begin, end in told) for t in range(a, b)) for a, b in spans]
    np.testing.assert_allclose(covered(spans[:, 0], spans[:, 1], told), np.array(expected, float))


@given(first=_spans, second=_spans)
def test_the_machine_is_slow_when_every_processor_is(
    first: list[tuple[int, int]], second: list[tuple[int, int]]
) -> None:
    """One slow processor shares its core with another that is busy: that was laid to the machine."""
    both = []
    for lengths in (first, second):
        ends = np.cumsum([(gap + 1, length + 1) for gap, length in lengths])  # spans one after the other
        both.append(np.asarray(ends, np.int64).reshape(-1, 2))
    expected = {t for t in range(400) if all(any(begin <= t < end for begin, end in spans) for spans in both)}
    assert {t for begin, end in common(both) for t in range(begin, end)} == expected


def test_one_slow_piece_of_work_is_an_interrupt_two_are_a_slow_processor() -> None:
    slowness = Slowness(limit_ns=45)
    told = [
        slowness.piece(begin, begin + took) for begin, took in ((0, 30), (100, 90), (200, 30), (300, 60), (400, 80))
    ]
    assert told == [None] * 5
    assert slowness.piece(500, 530) == (300, 480)
    assert slowness.piece(600, 630) is None


def _may_have_priority() -> bool:
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(WITNESS_PRIORITY))
    except OSError:
        return False
    os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
    return True


def _covered(witness: Witness, begin: int, end: int) -> int:
    """Standstills that cover the time from `begin`, plus a timer's period, to `end`."""
    found = witness.standstills()
    return 0 if found is None else int(((found[:, 0] <= begin + PERIOD_NS) & (found[:, 1] >= end)).sum())


def test_timers_that_start_one_after_the_other_watch_the_same_idle_time(monkeypatch: pytest.MonkeyPatch) -> None:
    """On a busy machine the second timer started when the first had watched all its time: no common time was left."""
    if not _may_have_priority():
        pytest.skip("the system grants no realtime scheduling")
    start = child.start

    def start_late(*args: Any) -> BaseProcess:
        time.sleep(0.15)
        return start(*args)

    monkeypatch.setattr(child, "start", start_late)
    with Witness(idle_s=0.1) as witness:
        begin, end = witness.idle_ns
    assert begin < end


def test_a_standstill_is_reported_with_begin_and_end() -> None:
    """The timers' processes are stopped, as by a host that stops the machine's processors."""
    if not _may_have_priority():
        pytest.skip("the system grants no realtime scheduling")
    with Witness(idle_s=0.2) as witness:
        assert witness.watches
        begin, end = witness.idle_ns
        assert begin < end <= time.perf_counter_ns()
        timers = [p for p in psutil.Process().children() if p.name().startswith("fm-witness")]
        assert timers
        for timer in timers:
            timer.send_signal(signal.SIGSTOP)
        for timer in timers:
            wait_until(lambda: timer.status() == psutil.STATUS_STOPPED, "the timer is stopped")  # noqa: B023
        begin = time.perf_counter_ns()
        time.sleep(0.05)
        end = time.perf_counter_ns()
        for timer in timers:
            timer.send_signal(signal.SIGCONT)
        wait_until(lambda: _covered(witness, begin, end) >= len(timers), "every timer reports the standstill")
        found = witness.standstills()
    assert found is not None
    assert not any(timer.is_running() for timer in timers)
    inside = found[(found[:, 1] > begin) & (found[:, 0] < end)]
    # Reported once: the next wait does not report the skipped periods again.
    assert (inside[:, 1] - inside[:, 0]).sum() <= len(timers) * (inside[:, 1].max() - inside[:, 0].min())
