"""A timer process that reports when the machine itself stood still."""

from __future__ import annotations

import os
import signal
import time

import numpy as np
import psutil
import pytest
from hypothesis import given
from hypothesis import strategies as st

from flexmotion.drivers.realtime.priority import WITNESS_PRIORITY
from flexmotion.drivers.realtime.witness import Witness, overlapping

from ...waiting import wait_until

pytestmark = pytest.mark.wall_clock

PERIOD_NS = 2_000_000

_spans = st.lists(st.tuples(st.integers(0, 60), st.integers(0, 20)), max_size=6)


@given(intervals=_spans, moments=_spans)
def test_intervals_that_overlap_a_standstill_are_found(
    intervals: list[tuple[int, int]], moments: list[tuple[int, int]]
) -> None:
    spans = np.array([(begin, begin + length) for begin, length in intervals], np.int64).reshape(-1, 2)
    told = np.array(sorted((begin, begin + length + 1) for begin, length in moments), np.int64).reshape(-1, 2)
    expected = [any(a < end and begin <= b for begin, end in told) for a, b in spans]
    np.testing.assert_array_equal(overlapping(spans[:, 0], spans[:, 1], told), np.array(expected, bool))


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


def test_a_standstill_is_reported_with_begin_and_end() -> None:
    """The timers' processes are stopped, as by a host that stops the machine's processors."""
    if not _may_have_priority():
        pytest.skip("the system grants no realtime scheduling")
    with Witness() as witness:
        wait_until(lambda: witness.standstills() is not None, "all timers run with their priority")
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
