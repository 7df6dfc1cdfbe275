"""Realtime settings of a process: scheduling, processors and their sleep states, locked memory."""

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

WITNESS_PRIORITY, LOOP_PRIORITY, ROBOT_PRIORITY, STOP_PRIORITY, PLANNER_PRIORITY = 80, 60, 40, 30, 20
"""SCHED_FIFO priorities: standstill timers, control loop, simulated robot or emulated bus, stop process, planner."""

WAKE_LATENCY = Path("/dev/cpu_dma_latency")
"""The kernel's PM QoS interface: limits the wake-up time of processors [µs] while the file is open."""

_MCL_CURRENT, _MCL_FUTURE, _MCL_ONFAULT = 1, 2, 4
_PR_SET_TIMERSLACK = 29


def claim(priority: int, *, allowed: bool = True) -> Scheduling:
    """Run this process under SCHED_FIFO on one processor, with exact timers, as far as the system permits.

    Loop and robot share the last processor, ordered by priority. The planner has the one before, where other work waits
    while a plan is made: on the loop's processor, plans took 1.8 times as long.

    Returns:
        "fifo", or "other" if the system refuses or `allowed` is False.
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
    """Context manager that limits the sleep states of all processors; it draws more power.

    A sleeping processor wakes late, later still if the host of a virtual machine runs other machines on it meanwhile.

    Args:
        latency_us: longest wake-up time [µs]; 0: processors do not sleep, None: no limit.

    Yields:
        Whether the system permits it. The limit ends with the process, however that ends.
    """
    try:
        held = None if latency_us is None else os.open(WAKE_LATENCY, os.O_WRONLY | os.O_CLOEXEC)
    except OSError:
        held = None  # missing or not permitted: the limit is optional
    if held is None or latency_us is None:
        yield False
        return
    try:
        os.write(held, latency_us.to_bytes(4, "little"))
        yield True
    finally:
        os.close(held)


def motion_processors() -> list[int]:
    """Processors of the motion, of those that this process may use: the planner's, then that of loop and robot."""
    return sorted(os.sched_getaffinity(0))[-2:]


def settle(*, collect: bool) -> None:
    """Lock this process's memory, freeze garbage collection of existing objects, limit linear algebra to one thread.

    `claim` leaves the process one processor: a thread of the linear algebra library would share it with the realtime
    thread that busily waits for it, and would never run.

    Args:
        collect: whether garbage collection continues for objects allocated from now on.
    """
    threadpool_limits(limits=1, user_api="blas")
    gc.collect()
    gc.freeze()
    if not collect:
        gc.disable()
    _libc().mlockall(_MCL_CURRENT | _MCL_FUTURE | _MCL_ONFAULT)


def _libc() -> ctypes.CDLL:
    return ctypes.CDLL(None, use_errno=True)
