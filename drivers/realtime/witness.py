"""`Witness`: timers with the highest priority detect when the machine itself stands still, or is slow.

A host stalls a virtual machine, and firmware any machine, whatever the priority of a process is. Realtime figures say
something about the program only for times in which these timers woke in time. A host may also let all processors run
ten times slower for some hundredths of a second while timers are punctual, so each timer times a fixed piece of work
too.
"""

from __future__ import annotations

import os
import time
from multiprocessing.process import BaseProcess
from types import TracebackType

import numpy as np

from flexmotion.drivers.realtime import child
from flexmotion.drivers.realtime.priority import WITNESS_PRIORITY, claim, motion_processors, settle
from flexmotion.drivers.realtime.ring import Ring, shared_array
from flexmotion.drivers.realtime.ticker import Ticker
from flexmotion.records import Bool, Float, Int, Record, column

_PERIOD_S = 0.002
_WORTH_NS = 500_000
"""Lateness of a timer above which its processor stood still [ns]."""
_KEPT = 16_384
_WORK = (1,) * 5000
"""Numbers that are added up as the fixed piece of work, about 30 µs of every 2 ms."""
_SLOW = 1.5
"""Work is slow when it takes longer than its median on the idle machine by this factor."""
_LASTS = 2
"""Pieces of work in a row that are slow before the processor counts as slow: an interrupt delays one."""
_IDLE_S = 3.0
"""How long the idle machine is watched [s]."""
_START_S = 0.02
"""Pause between two looks whether the timers are ready [s]."""
_STARTS, _READY, _WATCHES, _REFUSED = range(4)
"""States of a timer."""
_ROW = np.dtype([("begin_ns", "i8"), ("end_ns", "i8"), ("slow", "?")])


class _Timer(Record):
    """What a timer reports about itself, in shared memory."""

    state: Int = column("i8")
    """It starts, is ready, watches, or the system refused its priority."""
    begins: Bool = column("?")
    """Whether it may begin: a timer begins with the others, so that all have watched the same idle time."""
    idle_ns: Int = column("i8", 2)
    """Begin and end of the time in which it watched the idle machine [ns]."""


class Witness:
    """Context manager: a timer process on each processor that the motion runs on.

    It is entered when the timers know how long their work takes on the idle machine.

    Without realtime scheduling the timers would report other programs; then there is no result.

    Args:
        idle_s: how long the idle machine is watched first [s].
    """

    def __init__(self, idle_s: float = _IDLE_S) -> None:
        self._idle_s = idle_s
        self._rings = {processor: Ring(_ROW, _KEPT) for processor in motion_processors()}
        self._timers = _Timer(shared_array(len(self._rings), _Timer.dtype()))
        self._children: list[BaseProcess] = []

    def __enter__(self) -> Witness:
        for place, (processor, ring) in enumerate(self._rings.items()):
            timer = self._timers[place]
            self._children.append(
                child.start(f"witness-{processor}", _watch, processor, ring, timer, round(self._idle_s / _PERIOD_S))
            )
        self._wait_while(_STARTS)
        if (self._timers.state == _READY).all():
            self._timers.begins[...] = True
            self._wait_while(_READY)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        for one in self._children:
            one.kill()
            one.join()
        self._children.clear()

    @property
    def watches(self) -> bool:
        """Whether the system granted the priority to every timer."""
        return bool((self._timers.state == _WATCHES).all())

    @property
    def idle_ns(self) -> tuple[int, int]:
        """Begin and end of the time in which all timers watched the idle machine [ns]."""
        return int(self._timers.idle_ns[:, 0].max()), int(self._timers.idle_ns[:, 1].min())

    def standstills(self) -> Int | None:
        """Begin and end of every standstill of a processor, (k, 2), sorted by begin [`perf_counter_ns`].

        None if the system did not grant the priority to every timer.
        """
        found = self._spans(slow=False)
        if found is None:
            return None
        spans = np.concatenate(found)
        return spans[np.argsort(spans[:, 0], kind="stable")]

    def slowness(self) -> Int | None:
        """Begin and end of every time in which all processors were slow at once, likewise; of the idle machine too.

        One slow processor is no matter of the machine: it shares a core with another one that is busy.
        """
        found = self._spans(slow=True)
        return None if found is None else common(found)

    def _wait_while(self, state: int) -> None:
        """Until no timer is in `state`, or one has ended."""
        while (self._timers.state == state).any() and all(one.is_alive() for one in self._children):
            time.sleep(_START_S)

    def _spans(self, *, slow: bool) -> list[Int] | None:
        """Begins and ends that each timer found, (k, 2) each."""
        if not self.watches:
            return None
        rows = [ring.reader().read() for ring in self._rings.values()]
        return [np.column_stack([found["begin_ns"], found["end_ns"]])[found["slow"] == slow] for found in rows]


def common(spans: list[Int]) -> Int:
    """The times that lie in a span of every list, (k, 2); the spans of a list, (n, 2) each, do not overlap."""
    edges = np.concatenate([one.ravel() for one in spans])
    steps = np.concatenate([np.tile([1, -1], len(one)) for one in spans])
    # Where one span ends and another begins at once, the end counts first.
    order = np.lexsort((steps, edges))
    edges, depth = edges[order], np.cumsum(steps[order])
    inside = np.flatnonzero(depth == len(spans))
    return np.column_stack([edges[inside], edges[inside + 1]]).astype(np.int64)


def covered(begins: Int, ends: Int, moments: Int) -> Float:
    """How much of each of the intervals, (n,) and (n,), lies in one of `moments`, (k, 2) sorted by begin, (n,) [ns]."""
    if not len(moments):
        return np.zeros(len(begins))
    # Moments of two processors may overlap: each counts from the latest end of those before it.
    ended = np.concatenate([[moments[0, 0]], np.maximum.accumulate(moments[:, 1])])
    edges = np.column_stack([np.maximum(moments[:, 0], ended[:-1]), ended[1:]]).ravel()
    total = np.cumsum(np.diff(edges, prepend=edges[0]) * np.tile([0, 1], len(moments)))

    def before(times: Int) -> Float:
        found: Float = np.interp(times - edges[0], edges - edges[0], total)
        return found

    return before(ends) - before(begins)


class Slowness:
    """Finds when a processor is slow, from what a fixed piece of work takes on it.

    Args:
        limit_ns: a piece that takes longer is slow [ns].
    """

    def __init__(self, limit_ns: float) -> None:
        self.limit_ns = limit_ns
        self._pieces, self._begin_ns, self._end_ns = 0, 0, 0

    def piece(self, begin_ns: int, end_ns: int) -> tuple[int, int] | None:
        """Count a piece of work; returns begin and end of a time that was slow, once it is over."""
        if end_ns - begin_ns > self.limit_ns:
            self._begin_ns = self._begin_ns if self._pieces else begin_ns
            self._pieces, self._end_ns = self._pieces + 1, end_ns
            return None
        lasted, self._pieces = self._pieces, 0
        return (self._begin_ns, self._end_ns) if lasted >= _LASTS else None


def _watch(processor: int, ring: Ring, timer: _Timer, idle: int) -> None:
    os.sched_setaffinity(0, {processor})
    # First: a thread that the linear algebra library starts after a fork would inherit the priority, and spin for .1 s.
    settle(collect=False)
    if claim(WITNESS_PRIORITY) != "fifo":
        timer.state[...] = _REFUSED
        return
    ticker, row, end = Ticker(_PERIOD_S), np.zeros((), _ROW), 0
    timer.state[...] = _READY
    while not timer.begins:
        ticker.wait()

    def publish(begin_ns: int, end_ns: int, slow: bool) -> None:
        row["begin_ns"], row["end_ns"], row["slow"] = begin_ns, end_ns, slow
        ring.publish(row)

    pieces = np.empty((idle, 2), np.int64)
    for place in range(idle):
        ticker.wait()
        pieces[place] = _worked()
    slowness = Slowness(_SLOW * float(np.median(pieces[:, 1] - pieces[:, 0])))
    for one in pieces.tolist():
        span = slowness.piece(*one)
        if span is not None:
            publish(*span, True)
    timer.idle_ns[:] = pieces[0, 0], pieces[-1, 1]
    timer.state[...] = _WATCHES
    while True:
        ticker.wait()
        # From the first deadline that passed, including skipped ones, but not before the end of the last standstill.
        begin = max(ticker.deadline_ns - ticker.skipped * ticker.period_ns, end)
        end = ticker.deadline_ns + ticker.late_ns
        if end - begin > _WORTH_NS:
            publish(begin, end, False)
        span = slowness.piece(*_worked())
        if span is not None:
            publish(*span, True)


def _worked() -> tuple[int, int]:
    """Do the piece of work once; returns when it began and ended [ns]."""
    begin = time.perf_counter_ns()
    sum(_WORK)
    return begin, time.perf_counter_ns()
