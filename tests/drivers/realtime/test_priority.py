"""Limits of the wake-up time of processors, and scheduling of linear algebra."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from flexmotion.drivers.realtime import child, priority
from flexmotion.drivers.realtime.priority import WAKE_LATENCY, awake

from ...waiting import wait_until


def _asked_us() -> int:
    """The limit of all processes together [µs]."""
    return int.from_bytes(WAKE_LATENCY.read_bytes()[:4], "little", signed=True)


@pytest.fixture
def before() -> int:
    """The limit of other processes [µs]."""
    if not os.access(WAKE_LATENCY, os.R_OK | os.W_OK):
        pytest.skip(f"{WAKE_LATENCY} may not be written")
    if (asked := _asked_us()) <= 100:
        pytest.skip("something else keeps the processors awake")
    return asked


def wait_for_limit(asked: int) -> None:
    """Wait until the limit is this one.

    Regression: the limit is the machine's; a test failed while another program, a second run of these tests, held one.
    """
    wait_until(lambda: _asked_us() == asked, f"a limit of {asked} us")


def test_processors_stay_awake_within(before: int) -> None:
    """Regression: they slept between ticks, and woke up to 20 ms late on a busy host, 26 times in a minute."""
    with awake(0) as granted:
        assert granted and _asked_us() == 0
        with awake(100):
            assert _asked_us() == 0
    wait_for_limit(before)
    with awake(100):
        wait_for_limit(100)
    with awake(None) as granted:
        assert not granted
        wait_for_limit(before)


def _is_killed_awake() -> None:
    with awake(0):
        os.kill(os.getpid(), signal.SIGKILL)


def test_the_limit_ends_with_the_process(before: int) -> None:
    process = child.start("dies", _is_killed_awake)
    process.join()
    assert process.exitcode
    wait_for_limit(before)


def test_a_system_without_the_interface_is_no_error(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    for path in (tmp_path / "none", tmp_path):  # not there; not a file that can be written
        monkeypatch.setattr(priority, "WAKE_LATENCY", path)
        with awake(0) as granted:
            assert not granted


def test_linear_algebra_in_a_realtime_process_has_one_thread() -> None:
    """Regression: the planner hung at its first text target: BLAS busily waited for a thread that could not run.

    Both were on the one processor that the planner has, in realtime, the one that waits in front of the other.
    """
    code = """
import numpy as np
from flexmotion.drivers.realtime import child, priority
from flexmotion.drivers.realtime.priority import PLANNER_PRIORITY

wide, narrow = np.ones((2000, 600), np.float32), np.ones(600, np.float32)
wide @ narrow  # starts the library's threads, if it has any

def plan():
    priority.settle(collect=True)
    priority.claim(PLANNER_PRIORITY)
    for _ in range(20):
        wide @ narrow
    np.ones((400, 400)) @ np.ones((400, 400))

process = child.start("planner", plan)
process.join(90)
alive = process.is_alive()
process.kill()
print("hangs" if alive else process.exitcode)
"""
    threads = {name: value for name, value in os.environ.items() if not name.endswith("_NUM_THREADS")}
    done = subprocess.run([sys.executable, "-c", code], env=threads, capture_output=True, text=True, timeout=200)
    assert done.stdout == "0\n", done.stderr
