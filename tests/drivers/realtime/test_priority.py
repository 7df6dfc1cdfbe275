"""What a process is granted, and that it goes with the process."""

from __future__ import annotations

import os
import time
from multiprocessing.connection import Connection, Pipe
from pathlib import Path

import pytest

from drivers.realtime import child, priority
from drivers.realtime.priority import ROBOT_PRIORITY, WAKE_LATENCY, claim, may_stay_awake

pytestmark = pytest.mark.wall_clock


def _claimed(say: Connection) -> None:
    say.send(claim(ROBOT_PRIORITY))
    time.sleep(60.0)


def _without_that_file(say: Connection) -> None:
    priority.WAKE_LATENCY = Path("/dev/flexmotion-none")
    say.send((claim(ROBOT_PRIORITY), may_stay_awake()))


def _asked_latency_us() -> int:
    """What all processes together ask for now."""
    return int.from_bytes(WAKE_LATENCY.read_bytes()[:4], "little", signed=True)


def test_processors_stay_awake_as_long_as_a_process_has_priority() -> None:
    """Went wrong: processors slept between ticks; a busy host woke them up to 20 ms late, 26 times a minute."""
    hear, say = Pipe(duplex=False)
    if not may_stay_awake():
        pytest.skip(f"{WAKE_LATENCY} may not be written")
    if not (before := _asked_latency_us()):
        pytest.skip("something else keeps the processors awake")
    process = child.start("claims", _claimed, say)
    try:
        if hear.recv() != "fifo":
            pytest.skip("no SCHED_FIFO here")
        assert _asked_latency_us() == 0
    finally:
        process.kill()
        process.join()
    assert _asked_latency_us() == before


def test_a_system_that_cannot_keep_them_awake_is_no_error() -> None:
    hear, say = Pipe(duplex=False)
    process = child.start("claims", _without_that_file, say)
    granted, awake = hear.recv()
    process.join()
    assert process.exitcode == 0 and not awake
    assert granted in ("fifo", "other") and os.sched_getscheduler(0) == os.SCHED_OTHER
