"""What the system grants a process in time: realtime scheduling, an own processor that is awake, memory that stays."""

from __future__ import annotations

import ctypes
import gc
import os
from pathlib import Path
from typing import Literal

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

    Processors then do not sleep until it ends, where it may ask for that: one that slept wakes late, and later still
    where a host runs others on it meanwhile (in a minute on a busy one 1 deadline was missed instead of 26).

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
    _stay_awake()
    available = motion_processors()
    os.sched_setaffinity(0, {available[0 if priority == PLANNER_PRIORITY else -1]})
    return "fifo"


def may_stay_awake() -> bool:
    """Whether processes under SCHED_FIFO can keep the processors from sleeping."""
    return os.access(WAKE_LATENCY, os.W_OK)


def motion_processors() -> list[int]:
    """Processors that the motion runs on, of those this process may use: the planner's, then loop's and robot's."""
    return sorted(os.sched_getaffinity(0))[-2:]


def settle(*, collect: bool) -> None:
    """Keep what memory this process touches in place, and its garbage out of the collector's sight.

    Args:
        collect: whether the collector goes on with what is allocated from now on.
    """
    gc.collect()
    gc.freeze()
    if not collect:
        gc.disable()
    _libc().mlockall(_MCL_CURRENT | _MCL_FUTURE | _MCL_ONFAULT)


def _stay_awake() -> None:
    try:
        # Never closed: the kernel forgets it with the process.
        os.write(os.open(WAKE_LATENCY, os.O_WRONLY | os.O_CLOEXEC), (0).to_bytes(4, "little"))
    except OSError:
        return  # not there, or not ours: it is a help, not a need


def _libc() -> ctypes.CDLL:
    return ctypes.CDLL(None, use_errno=True)
