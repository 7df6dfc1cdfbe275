"""`Witness`: timers with the highest priority detect standstills of the machine itself.

A host stalls a virtual machine, and firmware any machine, whatever the priority of a process is. Realtime figures say
something about the program only for times in which these timers woke in time.
"""

from __future__ import annotations

import os
from multiprocessing.process import BaseProcess
from types import TracebackType

import numpy as np
from numpy.typing import NDArray

from flexmotion.drivers.realtime import child
from flexmotion.drivers.realtime.priority import WITNESS_PRIORITY, claim, motion_processors, settle
from flexmotion.drivers.realtime.ring import Ring, shared_array
from flexmotion.drivers.realtime.ticker import Ticker

_PERIOD_S = 0.002
_WORTH_NS = 500_000
"""Lateness of a timer above which its processor stood still [ns]."""
_KEPT = 16_384
_ROW = np.dtype([("begin_ns", "i8"), ("end_ns", "i8")])

Int = NDArray[np.int64]


class Witness:
    """Context manager: a timer process on each processor that the motion runs on.

    Without realtime scheduling the timers would report other programs; then there is no result.
    """

    def __init__(self) -> None:
        self._rings = {processor: Ring(_ROW, _KEPT) for processor in motion_processors()}
        self._watched = shared_array(len(self._rings), np.bool_)
        self._children: list[BaseProcess] = []

    def __enter__(self) -> Witness:
        for place, (processor, ring) in enumerate(self._rings.items()):
            watched = self._watched[place : place + 1]
            self._children.append(child.start(f"witness-{processor}", _watch, processor, ring, watched))
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        for one in self._children:
            one.kill()
            one.join()
        self._children.clear()

    def standstills(self) -> Int | None:
        """Begin and end of every standstill of a processor, (k, 2), sorted by begin [`perf_counter_ns`].

        None if the system did not grant the priority to every timer.
        """
        if not self._watched.all():
            return None
        rows = np.concatenate([ring.reader().read() for ring in self._rings.values()])
        rows.sort(order="begin_ns")
        return np.column_stack([rows["begin_ns"], rows["end_ns"]])


def overlapping(begins: Int, ends: Int, moments: Int) -> NDArray[np.bool_]:
    """Which of the intervals, (n,) and (n,), overlap with one of `moments`, (k, 2)."""
    if not len(moments):
        return np.zeros(len(begins), np.bool_)
    # Standstills of two processors may overlap: the latest end of all that have begun counts.
    latest_end = np.maximum.accumulate(moments[:, 1])
    begun = np.searchsorted(moments[:, 0], ends, side="right") - 1
    return (begun >= 0) & (latest_end[np.maximum(begun, 0)] > begins)


def _watch(processor: int, ring: Ring, watched: NDArray[np.bool_]) -> None:
    os.sched_setaffinity(0, {processor})
    if claim(WITNESS_PRIORITY) != "fifo":
        return
    settle(collect=False)
    watched[0] = True
    ticker, row, end = Ticker(_PERIOD_S), np.zeros((), _ROW), 0
    while True:
        ticker.wait()
        # From the first deadline that passed, including skipped ones, but not before the end of the last standstill.
        begin = max(ticker.deadline_ns - ticker.skipped * ticker.period_ns, end)
        end = ticker.deadline_ns + ticker.late_ns
        if end - begin > _WORTH_NS:
            row["begin_ns"], row["end_ns"] = begin, end
            ring.publish(row)
