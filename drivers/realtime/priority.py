"""What the system grants a process in time: realtime scheduling, processors of its own and awake, memory that stays."""

from __future__ import annotations

import ctypes
import gc
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Literal

from threadpoolctl import threadpool_limits

Scheduling = Literal["fifo", "other"]

WITNESS_PRIORITY, LOOP_PRIORITY, ROBOT_PRIORITY, PLANNER_PRIORITY = 80, 60, 40, 20
"""Of a timer that watches the machine, of the control loop, of a simulated robot or an emulated bus, and of the planner
(SCHED_FIFO)."""

WAKE_LATENCY = Path("/dev/cpu_dma_latency")
"""Takes the longest time [µs] that a processor may need to wake, for as long as the file is open (the kernel's PM QoS
interface)."""

_MCL_CURRENT, _MCL_FUTURE, _MCL_ONFAULT = 1, 2, 4
_PR_SET_TIMERSLACK = 29


def claim(priority: int, *, allowed: bool = True) -> Scheduling:
    """Run this process under SCHED_FIFO on a processor of the motion's, its timers exact, as far as that is granted.

    Loop and robot have the last processor, ordered by priority; the planner has the one before, whose other work waits
    while a plan is made (sharing the first one it took 1.8 times as long).

    Returns:
        "fifo", or "other" where the system refuses or it is not `allowed`.
    """
    _libc().prctl(_PR_SET_TIMERSLACK, 1, 0, 0, 0)
    if not allowed:
        return "other"
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(priority))
    except OSError:
        return "other"
    available = motion_processors()
    os.sched_setaffinity(0, {available[0 if priority == PLANNER_PRIORITY else -1]})
    return "fifo"


@contextmanager
def awake(latency_us: int | None) -> Iterator[bool]:
    """Within, no processor sleeps so deeply that it needs longer to wake; it draws more power.

    One that slept wakes late, and later still where the host of a virtual machine runs others on it meanwhile.

    Args:
        latency_us: longest time to wake [µs]; 0 keeps them from sleeping at all, None asks for nothing.

    Yields:
        Whether that is granted. It ends with the process, however that ends.
    """
    try:
        held = None if latency_us is None else os.open(WAKE_LATENCY, os.O_WRONLY | os.O_CLOEXEC)
    except OSError:
        held = None  # not there, or not ours: it is a help, not a need
    if held is None or latency_us is None:
        yield False
        return
    try:
        os.write(held, latency_us.to_bytes(4, "little"))
        yield True
    finally:
        os.close(held)


def motion_processors() -> list[int]:
    """Processors that the motion runs on, of those this process may use: the planner's, then loop's and robot's."""
    return sorted(os.sched_getaffinity(0))[-2:]


def settle(*, collect: bool) -> None:
    """Keep this process's memory in place, its garbage out of the collector's sight, its linear algebra in one thread.

    A thread of the linear algebra library would share the one processor that `claim` gives with the one that waits for
    it, at a priority that lets it wait for good.

    Args:
        collect: whether the collector goes on with what is allocated from now on.
    """
    threadpool_limits(limits=1, user_api="blas")
    gc.collect()
    gc.freeze()
    if not collect:
        gc.disable()
    _libc().mlockall(_MCL_CURRENT | _MCL_FUTURE | _MCL_ONFAULT)


def _libc() -> ctypes.CDLL:
    return ctypes.CDLL(None, use_errno=True)
