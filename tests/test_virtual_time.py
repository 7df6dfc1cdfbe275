"""The clock on which tests of live runs depend."""

from __future__ import annotations

import os
import signal
import time

import numpy as np
import psutil
import pytest

from flexmotion.drivers.realtime import child
from flexmotion.drivers.realtime.ring import shared_array

from .virtual_time import virtual_time
from .waiting import wait_until

HOUR_S = 3600.0


def count(ticks: np.ndarray, period_s: float) -> None:
    """Count periods for an hour, each with some work in it."""
    for _ in range(round(HOUR_S / period_s)):
        time.sleep(period_s)
        sum(range(1000))
        ticks[0] += 1


def test_an_hour_passes_at_once_and_alike_for_all_processes() -> None:
    fast, slow = shared_array(1, np.int64), shared_array(1, np.int64)
    with virtual_time() as clock:
        begin = time.perf_counter()
        processes = [child.start("fast", count, fast, 60.0), child.start("slow", count, slow, 600.0)]
        seen = []
        for _ in range(6):
            time.sleep(HOUR_S / 6 + 1.0)
            seen.append((int(fast[0]), int(slow[0])))
        for process in processes:
            process.join()
        assert clock.perf_counter() - begin == pytest.approx(HOUR_S, abs=30.0)
    assert seen == [(10 * k, k) for k in range(1, 7)]


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGSTOP])
def test_a_process_that_was_killed_or_stopped_is_not_waited_for(number: signal.Signals) -> None:
    ticks = shared_array(1, np.int64)
    with virtual_time():
        process = child.start("counter", count, ticks, 1.0)
        assert process.pid is not None
        time.sleep(10.5)
        os.kill(process.pid, number)
        stopped = (psutil.STATUS_STOPPED, psutil.STATUS_ZOMBIE)
        wait_until(lambda: psutil.Process(process.pid).status() in stopped, "the process to stop")
        before = int(ticks[0])
        time.sleep(HOUR_S)
        assert ticks[0] == before >= 10
        process.kill()
        process.join()


def test_processes_outside_have_the_real_clock() -> None:
    with virtual_time():
        time.sleep(HOUR_S)
        ahead = time.perf_counter()
    assert time.perf_counter() < ahead
