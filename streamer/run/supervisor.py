"""`Supervisor`: starts the processes of a live run, passes on what the operator asks, notices who dies, cleans up."""

from __future__ import annotations

import contextlib
import os
import signal
import time
from collections.abc import Callable
from dataclasses import dataclass
from multiprocessing.connection import Connection, Pipe, wait
from multiprocessing.process import BaseProcess
from typing import Any, Protocol, cast

import psutil

from flexmotion.configs.errors import DriverError
from flexmotion.configs.stream import StreamSettings
from flexmotion.drivers.realtime import child
from flexmotion.drivers.realtime.priority import Scheduling
from flexmotion.streamer.control.loop import ControlLoop
from flexmotion.streamer.control.run_trace import Collector
from flexmotion.streamer.control.telemetry import Event
from flexmotion.streamer.planning.replanning import Replanner
from flexmotion.streamer.run import loop_process, planner_process
from flexmotion.streamer.run.lifecycle import Lifecycle
from flexmotion.streamer.run.planner_process import Heartbeat
from flexmotion.streamer.run.requests import Request, RequestChannel

_LOOK_S = 0.02
"""How often it looks after everybody [s]."""
_SILENT_S = 0.6
"""A planner that has not moved for this long is told of [s]."""
_STILL_S, _OPENING_S, _QUIT_S = 2.0, 30.0, 1.0
"""A loop that has not moved for so long, has not opened its driver, or has not quit is killed [s]."""
_PARKING_S = 15.0
"""What a loop is left to bring the robot down in, when the supervisor itself has failed [s]."""
_WARM_S = 5.0
"""After this long a process has touched what it needs [s]."""
_LAST_WORDS_S = 2.0
"""What a service has to finish in, a log to be closed say [s]."""


class Service(Protocol):
    """Something that follows a run and may die without harm to it: a recorder, a viewer.

    Attributes:
        name: what it is called in messages.
    """

    name: str

    def follow(self) -> Callable[[bool], None]:
        """What is to be called over and over: it takes whether this is the last time. Runs in the service's process."""
        ...


@dataclass
class _Running:
    service: Service
    process: BaseProcess
    missed: bool = False


class Supervisor:
    """Runs loop, planner and services as processes, and watches them.

    Args: as of `flexmotion.streamer.run.session.Session`; `controls` are those of this process's user and those of the
        planner.
    """

    def __init__(
        self,
        loop: ControlLoop,
        replanner: Replanner,
        settings: StreamSettings,
        controls: tuple[RequestChannel, RequestChannel],
        *,
        seconds: float | None,
        stay: bool,
        realtime: bool,
        services: tuple[Service, ...] = (),
        wake: int | None = None,
    ) -> None:
        self.loop, self.replanner, self.realtime = loop, replanner, realtime
        self.lifecycle = Lifecycle(loop, settings, seconds=seconds, stay=stay)
        self.services, self.wake = services, wake
        self.outside_controls, self.planner_controls = controls
        self.controls = RequestChannel()
        self.heartbeat = Heartbeat()
        self._silent = False
        self._begun_ns, self._quit_ns, self._killed = time.perf_counter_ns(), 0, ""
        self.memory_mb: tuple[float, float] | None = None
        """Memory of the loop's process, some seconds after its start and last [MB]."""

    def run(
        self,
        collector: Collector,
        request: Callable[[], Request | None] | None,
        progress: Callable[[float], None] | None,
        tell: Callable[[Event], None],
    ) -> Scheduling:
        """Run to the end.

        Returns:
            The scheduling that the loop was granted.

        Raises:
            DriverError: the driver failed, or the loop's process died.
        """
        ears, mouth = Pipe(duplex=False)
        rate = self.loop.robot.rate_hz
        planner = child.start(
            "planner",
            planner_process.serve,
            self.replanner,
            self.loop.telemetry.ticks,
            rate,
            self.planner_controls,
            self.heartbeat,
            self.realtime,
        )
        running = [
            _Running(service, child.start(service.name, _follow, service, orphaned=signal.SIGTERM))
            for service in self.services
        ]
        loop = child.start(
            "loop",
            loop_process.serve,
            self.loop,
            self.lifecycle,
            [self.outside_controls, self.controls, self.planner_controls],
            self.realtime,
            mouth,
            orphaned=signal.SIGTERM,
        )
        mouth.close()
        try:
            while loop.is_alive():
                self._wait(loop)
                asked = None if request is None else request()
                if asked is not None:
                    self.controls.ask(asked)
                self._look_after_loop(loop, asked)
                self._look_after_planner(planner)
                self._look_after(running)
                self._measure_memory(loop)
                # Whoever reads what is said may be gone; that is no reason to stop.
                with contextlib.suppress(OSError, ValueError):
                    for event in collector.collect():
                        tell(event)
                    if progress is not None and collector.record.used:
                        progress(float(collector.record.source_s[-1]))
            with contextlib.suppress(OSError, ValueError):
                for event in collector.collect():
                    tell(event)
            return self._outcome(loop, ears)
        except BaseException:
            # The robot is not to pay for it.
            self.controls.ask(Request.END)
            loop.join(_PARKING_S)
            raise
        finally:
            for process in (loop, planner):
                child.end(process, patience_s=0.0)
            for one in running:
                one.process.terminate()
                child.end(one.process, patience_s=_LAST_WORDS_S)

    def _wait(self, loop: BaseProcess) -> None:
        """Until something happens, or it is time to look."""
        sources: list[int] = [loop.sentinel] if self.wake is None else [loop.sentinel, self.wake]
        ready = wait(sources, _LOOK_S)
        if self.wake is not None and self.wake in ready:
            with contextlib.suppress(BlockingIOError):
                os.read(self.wake, 4096)

    def _look_after_loop(self, loop: BaseProcess, asked: Request | None) -> None:
        """Kill a loop that does not move, and one that was told to quit and does not."""
        now = time.perf_counter_ns()
        if asked is Request.QUIT:
            self._quit_ns = self._quit_ns or now
        newest = self.loop.telemetry.ticks.latest()
        since, patience = (self._begun_ns, _OPENING_S) if newest is None else (int(newest["stamp_ns"]), _STILL_S)
        if now - since > patience * 1e9:
            self._killed = f"it did not move for {patience:g} s"
        elif self._quit_ns and now - self._quit_ns > _QUIT_S * 1e9:
            self._killed = "it did not end when told to"
        if self._killed:
            loop.kill()

    def _look_after_planner(self, planner: BaseProcess) -> None:
        """Tell the loop, once, of a planner that is gone or stands still: what plays ends in its own stop."""
        silent = not planner.is_alive() or self.heartbeat.age_s > _SILENT_S
        if silent == self._silent:
            return
        self._silent = silent
        if not silent:
            self.controls.ask(Request.NOTE, "the planner moves again")
        elif planner.is_alive():
            self.controls.ask(Request.LOST, f"the planner has not moved for {_SILENT_S:g} s")
        elif planner.exitcode:
            self.controls.ask(Request.LOST, f"the planner's process died ({_cause(planner)})")

    def _measure_memory(self, loop: BaseProcess) -> None:
        if self.loop.telemetry.ticks.count < _WARM_S * self.loop.robot.rate_hz or loop.pid is None:
            return
        with contextlib.suppress(psutil.NoSuchProcess):
            now = psutil.Process(loop.pid).memory_info().rss * 1e-6
            if now > 0.0:  # a process that has just ended has none
                self.memory_mb = (now if self.memory_mb is None else self.memory_mb[0], now)

    def _look_after(self, running: list[_Running]) -> None:
        """Tell, once, of a service that is gone; the run goes on without it."""
        for one in running:
            if not one.missed and not one.process.is_alive():
                one.missed = True
                self.controls.ask(Request.NOTE, f"{one.service.name} ended ({_cause(one.process)}); the run goes on")

    def _outcome(self, loop: BaseProcess, ears: Connection) -> Scheduling:
        """What the loop's process left: the scheduling it had. Raises what ended it."""
        said: list[Any] = []
        while ears.poll():
            try:
                said.append(ears.recv())
            except EOFError:
                break
        loop.join()
        if loop.exitcode:
            reason = f"was ended: {self._killed}" if self._killed else f"died ({_cause(loop)})"
            raise DriverError(f"the control loop's process {reason}: the servos are left to their watchdog")
        if said[-1] is not None:
            raise said[-1]
        return cast(Scheduling, said[0])


def _cause(process: BaseProcess) -> str:
    code = process.exitcode or 0
    return f"signal {-code}" if code < 0 else f"exit code {code}"


def _follow(service: Service) -> None:
    """A service's process: follows until it is asked to end, and once more."""
    ended: list[int] = []
    signal.signal(signal.SIGTERM, lambda number, _frame: ended.append(number))
    follow = service.follow()
    while not ended:
        follow(False)
        time.sleep(_LOOK_S)
    follow(True)
