"""The clock on which tests of live runs depend."""

from __future__ import annotations

import ctypes
import os
import platform
import signal
import threading
import time

import numpy as np
import psutil
import pytest

from flexmotion.drivers.realtime import child
from flexmotion.drivers.realtime.ring import shared_array

from .virtual_time import virtual_time
from .waiting import wait_until

HOUR_S = 3600.0
_EXIT = {"x86_64": 60, "aarch64": 93}
"""Number of the system call that ends one thread, by machine."""


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


@pytest.mark.skipif(platform.machine() not in _EXIT, reason="the number of the system call is unknown here")
def test_a_process_is_waited_for_until_its_last_thread_has_ended() -> None:
    """A starved loop's first thread had ended, its others had not: time passed, and it was taken for hung."""
    ready, go_on = os.pipe()
    ended = shared_array(1, np.int64)

    def lose_the_first_thread() -> None:
        def outlive() -> None:
            os.read(ready, 1)
            ended[0] = 1
            os._exit(0)

        threading.Thread(target=outlive).start()
        ctypes.CDLL(None).syscall(_EXIT[platform.machine()], 0)

    with virtual_time() as clock:
        process = child.start("threads", lose_the_first_thread)
        assert process.pid is not None
        while psutil.Process(process.pid).status() != psutil.STATUS_ZOMBIE:
            os.sched_yield()  # on the real clock: virtual time stands still for the thread that is left
        threading.Timer(0.2, os.write, (go_on, b".")).start()
        begin = clock.perf_counter()
        time.sleep(HOUR_S)
        assert ended[0] == 1
        assert clock.perf_counter() - begin == pytest.approx(HOUR_S)
        process.join()


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
