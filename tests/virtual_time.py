"""A clock for real processes that passes only while all of them sleep, so that no machine is too slow for them."""

from __future__ import annotations

import math
import os
import select
import signal
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from multiprocessing import connection
from multiprocessing.process import BaseProcess
from typing import Any

import numpy as np
import pytest

from flexmotion.drivers.realtime import child
from flexmotion.drivers.realtime.ring import shared_array
from flexmotion.drivers.sim import process as sim_process
from flexmotion.streamer.planning.planner import Planned, Planner
from flexmotion.streamer.run import supervisor

_OPENING_S = 240.0
"""How long the simulated robot's process may take to start [s of real time]."""
_PROCESSES = 32
"""Most processes of one test."""
_LOOK_S = 0.002
"""How often the arbiter looks for processes that were killed, stopped or have ended [s of real time]."""
_POLL_S = 0.002
"""How often a process that waits for another one looks [s of virtual time]."""

_sleep, _kill = time.sleep, os.kill


@dataclass(frozen=True)
class Costs:
    """Virtual time that making a plan takes [s].

    Attributes:
        plan_s: before the human motion is retargeted.
        checkpoint_s: at each checkpoint: about one for each frame of the human motion.
    """

    plan_s: float = 0.0
    checkpoint_s: float = 0.0


class VirtualTime:
    """`time.perf_counter` and `time.sleep` of this process and of those that `child.start` starts.

    Time stands still while any of them computes. When all of them sleep it jumps to the moment at which the first one
    is to wake. A process that was killed or stopped is not waited for. Signals, shared memory and the order of events
    are those of a run on the real clock; work takes no time, unless `virtual_time` is given its cost.

    Args:
        fastest: seconds that may pass in a second of the real clock, as far as the machine can.
    """

    def __init__(self, fastest: float = math.inf) -> None:
        self._fastest, self._begun_ns = fastest, time.perf_counter_ns()
        self._now = _shared(1)
        self._wake = _shared(_PROCESSES)
        """When each process wakes [ns]; it runs where that has passed."""
        self._pid = _shared(_PROCESSES)
        self._known = _shared(1)
        """Processes that were started so far."""
        self._pipes = [os.pipe() for _ in range(_PROCESSES)]
        self._asleep = os.pipe()
        for end in (*(end for _, end in self._pipes), *self._asleep):
            os.set_blocking(end, False)
        self._now[0] = self._begun_ns
        self._number = self._add()
        self._pid[self._number] = os.getpid()

    def close(self) -> None:
        for ends in (*self._pipes, self._asleep):
            for end in ends:
                os.close(end)

    def perf_counter_ns(self) -> int:
        return self._now[0]

    def perf_counter(self) -> float:
        return self.perf_counter_ns() * 1e-9

    def sleep(self, seconds: float) -> None:
        if threading.current_thread() is not threading.main_thread():
            _sleep(seconds)  # of a server, say: nothing that a run waits for
            return
        until = self._wake[self._number] = self._now[0] + max(round(seconds * 1e9), 1)
        _write(self._asleep[1])
        wakes = self._pipes[self._number][0]
        while self._now[0] < until:
            os.read(wakes, 4096)

    def start(self, name: str, target: Callable[..., None], *args: Any, **options: Any) -> BaseProcess:
        """`child.start`, of a process that has this clock from its first moment on."""
        number = self._add()

        def run(*given: Any) -> None:
            self._number = number
            target(*given)

        process = _start(name, run, *args, **options)
        self._pid[number] = process.pid or 0
        return process

    def join(self, process: BaseProcess, timeout: float | None = None) -> None:
        """`BaseProcess.join`."""
        end = None if timeout is None else self._now[0] + round(timeout * 1e9)
        while process.is_alive() and (end is None or self._now[0] < end):
            self.sleep(_POLL_S)

    def kill(self, pid: int, number: int) -> None:
        """`os.kill`; no time passes until a process that is killed or stopped has ended or stopped."""
        _kill(pid, number)
        while number in (signal.SIGKILL, signal.SIGSTOP) and _runs(pid):
            select.select([], [], [], _LOOK_S)

    def wait(self, sources: Sequence[Any], timeout: float) -> list[Any]:
        """`multiprocessing.connection.wait`; what happens meanwhile is seen at the end of the time."""
        self.sleep(timeout)
        return connection.wait(sources, 0.0)

    def arbitrate(self) -> None:
        """Let time pass, as long as there is a process that has this clock."""
        while any(_state(pid) for pid in self._pid[: self._known[0]]):
            for _ in range(100):
                select.select([self._asleep[0]], [], [], _LOOK_S)
                _drain(self._asleep[0])
                self._advance()

    def _add(self) -> int:
        number = self._known[0]
        assert number < _PROCESSES, "more processes than virtual time has places for"
        self._known[0] += 1
        return number

    def _advance(self) -> None:
        now = self._now[0]
        wakes = self._wake[: self._known[0]].tolist()
        asleep = [wake for wake in wakes if wake > now]
        # Plain numbers: this runs thousands of times in a second of virtual time.
        if not asleep or any(_runs(self._pid[number]) for number, wake in enumerate(wakes) if wake <= now):
            return
        first = min(asleep)
        if first - self._begun_ns > self._fastest * (time.perf_counter_ns() - self._begun_ns):
            return
        self._now[0] = first
        for number, wake in enumerate(wakes):
            if wake == first:
                _write(self._pipes[number][1])


def _shared(count: int) -> memoryview:
    """Whole numbers, shared with processes that are forked from this one; a view is read faster than an array."""
    return memoryview(shared_array(count, np.int64))


def _runs(pid: int) -> bool:
    """Whether a process may go on computing: it has neither ended nor been stopped; 0 is about to start."""
    return not pid or _state(pid) not in ("", "T", "t")


def _state(pid: int) -> str:
    """State of a process as `ps` shows it; empty where it has ended.

    A process whose first thread has ended is a zombie to `ps`; its parent can only wait for it when all have.
    """
    try:
        file = os.open(f"/proc/{pid}/stat", os.O_RDONLY)
        try:
            fields = os.read(file, 4096).rpartition(b")")[2].split()
        finally:
            os.close(file)
    except (FileNotFoundError, ProcessLookupError):
        return ""
    state, threads = fields[0].decode(), int(fields[17])
    return "" if state in "ZXx" and threads <= 1 else state


def _write(end: int) -> None:
    with suppress(BlockingIOError):  # full: what reads it has enough to wake for
        os.write(end, b".")


def _drain(end: int) -> None:
    with suppress(BlockingIOError):
        os.read(end, 4096)


_start = child.start
_plan = Planner.plan


def _charged(costs: Costs) -> Callable[..., Planned]:
    """`Planner.plan` that takes as long as `costs` says."""

    def plan(planner: Planner, *args: Any, checkpoint: Callable[[], None] = lambda: None, **options: Any) -> Planned:
        def charged_checkpoint() -> None:
            time.sleep(costs.checkpoint_s)
            checkpoint()

        begin = time.perf_counter()
        time.sleep(costs.plan_s)
        slept = time.perf_counter() - begin
        planned = _plan(planner, *args, checkpoint=charged_checkpoint, **options)
        return replace(planned, sample_s=planned.sample_s + slept)

    return plan


@contextmanager
def virtual_time(fastest: float = math.inf, costs: Costs | None = None) -> Iterator[VirtualTime]:
    """Virtual time in this process and in those that it starts, as long as it is open.

    Args:
        fastest: see `VirtualTime`.
        costs: time that making plans takes; None: none.
    """
    clock = VirtualTime(fastest)
    # Time passes as well for processes that outlive this one.
    arbiter = _start("time", clock.arbitrate, orphaned=signal.SIGCONT)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(time, "perf_counter", clock.perf_counter)
        patch.setattr(time, "perf_counter_ns", clock.perf_counter_ns)
        patch.setattr(time, "sleep", clock.sleep)
        patch.setattr(child, "start", clock.start)
        patch.setattr(BaseProcess, "join", lambda process, timeout=None: clock.join(process, timeout))
        patch.setattr(os, "kill", clock.kill)
        patch.setattr(supervisor, "wait", clock.wait)
        patch.setattr(sim_process, "_OPEN_PATIENCE_S", _OPENING_S)  # on the real clock
        if costs is not None:
            patch.setattr(Planner, "plan", _charged(costs))
        try:
            yield clock
        finally:
            patch.undo()
            arbiter.kill()
            arbiter.join()
            clock.close()
