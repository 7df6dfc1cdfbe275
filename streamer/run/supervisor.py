"""`Supervisor`: starts, checks and ends the processes of a run on the real clock, and forwards requests to the loop.

`flexmotion.streamer.run.session.Session` is the run; `flexmotion.streamer.run.lifecycle.Lifecycle`, in the loop's
process, is the robot's course through it.
"""

from __future__ import annotations

import contextlib
import os
import signal
import time
from collections.abc import Callable
from dataclasses import dataclass
from multiprocessing.connection import Connection, Pipe, wait
from multiprocessing.process import BaseProcess
from typing import Any, Protocol, cast, runtime_checkable

import psutil

from flexmotion.configs.errors import DriverError
from flexmotion.configs.stream import StreamSettings
from flexmotion.drivers.realtime import child
from flexmotion.drivers.realtime.priority import Scheduling
from flexmotion.streamer.control.ladder import State
from flexmotion.streamer.control.loop import ControlLoop
from flexmotion.streamer.control.run_trace import Collector
from flexmotion.streamer.control.telemetry import Event
from flexmotion.streamer.control.tick_row import TickRow
from flexmotion.streamer.planning.replanning import Replanner
from flexmotion.streamer.run import loop_process
from flexmotion.streamer.run.lifecycle import Lifecycle
from flexmotion.streamer.run.loop_process import WAITING
from flexmotion.streamer.run.notify import Notifier
from flexmotion.streamer.run.planner_guard import PlannerGuard
from flexmotion.streamer.run.planner_process import Heartbeat
from flexmotion.streamer.run.requests import Request, RequestChannel

_POLL_S = 0.02
"""Pause between two checks of the processes [s]."""
_STILL_S, _OPENING_S, _QUIT_S = 2.0, 30.0, 1.0
"""The loop's process is killed if it does not tick for this long, opens its driver for this long, or does not end this
long after a request to quit [s]."""
_PARKING_S = 15.0
"""Time that the loop has to park the robot when the supervisor itself has failed [s]."""
_WARM_S = 5.0
"""After this long a process has touched the memory that it needs [s]."""
_CLOSING_S = 2.0
"""Time that a service has to finish, such as to close a log [s]."""


class Service(Protocol):
    """A follower of a run whose failure does not affect the run, such as a recorder or a viewer.

    Attributes:
        name: what messages call it.
    """

    name: str

    def follow(self) -> Callable[[bool], None]:
        """Function to call over and over, with whether this is the last call. Runs in the service's process."""
        ...


@runtime_checkable
class RequestingService(Service, Protocol):
    """A service that sends requests to the loop, such as a gateway.

    Attributes:
        requests: its channel, which the loop reads before every tick.
    """

    requests: RequestChannel


@runtime_checkable
class HeldService(Service, Protocol):
    """A service that holds something until the run is over, such as the lock of a log."""

    def end(self) -> None:
        """Called in the process that started the run, when it is over."""
        ...


def requests_of(services: tuple[Service, ...]) -> list[RequestChannel]:
    """The channels of those services that send requests."""
    return [service.requests for service in services if isinstance(service, RequestingService)]


@dataclass
class _Running:
    service: Service
    process: BaseProcess
    reported: bool = False


class Supervisor:
    """Runs loop, planner and services as processes, and checks that they run.

    Args:
        channels: requests of this process's user, and of the planner.
        seconds, stay, armed, attended, patient, realtime, services, wake, waits: see
            `flexmotion.streamer.run.session.Session`.

    Attributes:
        memory_mb: memory of the loop's process, some seconds after its start and last [MB]; None if never measured.
    """

    def __init__(
        self,
        loop: ControlLoop,
        replanner: Replanner,
        settings: StreamSettings,
        channels: tuple[RequestChannel, RequestChannel],
        *,
        seconds: float | None,
        stay: bool,
        armed: bool,
        attended: bool,
        patient: bool = False,
        realtime: bool,
        services: tuple[Service, ...] = (),
        wake: int | None = None,
        waits: bool = False,
    ) -> None:
        self.loop, self.replanner, self.realtime = loop, replanner, realtime
        self.lifecycle = Lifecycle(
            loop, settings, seconds=seconds, stay=stay, armed=armed, attended=attended, patient=patient
        )
        self.services, self.wake = services, wake
        self.user_requests, self.planner_requests = channels
        self.requests = RequestChannel()
        self.waits, self.opening = waits, Heartbeat()
        self.notifier = Notifier()
        self._told, self._opening_polls = "", 0
        self._begun_ns, self._quit_ns, self._killed = time.perf_counter_ns(), 0, ""
        self.memory_mb: tuple[float, float] | None = None

    def run(
        self,
        collector: Collector,
        next_request: Callable[[], Request | None] | None,
        progress: Callable[[float], None] | None,
        on_event: Callable[[Event], None],
    ) -> Scheduling:
        """Run to the end.

        Args:
            collector: of the loop's telemetry.
            next_request, progress, on_event: see `flexmotion.streamer.run.session.Session`.

        Returns:
            The scheduling that the loop was granted.

        Raises:
            DriverError: the driver failed, or the loop's process died.
        """
        outcome_receiver, outcome_sender = Pipe(duplex=False)
        planner = PlannerGuard(
            self.replanner,
            self.loop.telemetry.ticks,
            self.loop.robot.rate_hz,
            self.planner_requests,
            self.requests,
            realtime=self.realtime,
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
            [*requests_of(self.services), self.user_requests, self.requests, self.planner_requests],
            self.opening if self.waits else None,
            self.realtime,
            outcome_sender,
            orphaned=signal.SIGTERM,
        )
        outcome_sender.close()
        try:
            while loop.is_alive():
                self._wait(loop)
                request = None if next_request is None else next_request()
                if request is not None:
                    self.requests.send(request)
                if request in (Request.END, Request.QUIT):
                    self.notifier.stopping()
                self._check_loop(loop, request)
                planner.check()
                self._check_services(running)
                self._measure_memory(loop)
                self._notify()
                # The reader of a pipe that events are printed to may have gone; the run continues.
                with contextlib.suppress(OSError, ValueError):
                    for event in collector.collect():
                        on_event(event)
                        self._told = event.message if event.message.startswith(WAITING) else self._told
                    if progress is not None and collector.record.used:
                        progress(float(collector.record.source_s[-1]))
            with contextlib.suppress(OSError, ValueError):
                for event in collector.collect():
                    on_event(event)
            return self._outcome(loop, outcome_receiver)
        except BaseException:
            # Whatever failed here, the robot is parked.
            self.requests.send(Request.END)
            loop.join(_PARKING_S)
            raise
        finally:
            child.end(loop, patience_s=0.0)
            planner.end()
            for one in running:
                one.process.terminate()
                child.end(one.process, patience_s=_CLOSING_S)
                if isinstance(one.service, HeldService):
                    one.service.end()

    def _wait(self, loop: BaseProcess) -> None:
        """Wait until the loop's process ends, `wake` is readable, or the next check is due."""
        sources: list[int] = [loop.sentinel] if self.wake is None else [loop.sentinel, self.wake]
        ready = wait(sources, _POLL_S)
        if self.wake is not None and self.wake in ready:
            with contextlib.suppress(BlockingIOError):
                os.read(self.wake, 4096)

    def _check_loop(self, loop: BaseProcess, request: Request | None) -> None:
        """Kill the loop's process if it does not tick, or does not end after a request to quit."""
        now = time.perf_counter_ns()
        if request is Request.QUIT:
            self._quit_ns = self._quit_ns or now
        newest = self.loop.telemetry.ticks.latest()
        since, patience = (max(self._begun_ns, self.opening.stamp_ns), _OPENING_S)
        if newest is not None:
            since, patience = int(TickRow(newest).stamp_ns), _STILL_S
        if now - since > patience * 1e9:
            self._killed = f"it did not tick for {patience:g} s"
        elif self._quit_ns and now - self._quit_ns > _QUIT_S * 1e9:
            self._killed = "it did not end when asked to"
        if self._killed:
            loop.kill()

    def _notify(self) -> None:
        """Tell the service manager what the loop does."""
        telemetry = self.loop.telemetry.ticks
        row = telemetry.latest()
        if row is None:
            # A driver may take longer to open than the watchdog waits; one that hangs is ended by `_check_loop`.
            self._opening_polls += self.opening.beats > 0
            self.notifier.progress(self.opening.beats + self._opening_polls, self._told or "starting")
        else:
            self.notifier.progress(
                self.opening.beats + self._opening_polls + telemetry.count, State(int(row["state"])).name
            )

    def _measure_memory(self, loop: BaseProcess) -> None:
        if self.loop.telemetry.ticks.count < _WARM_S * self.loop.robot.rate_hz or loop.pid is None:
            return
        with contextlib.suppress(psutil.NoSuchProcess):
            now = psutil.Process(loop.pid).memory_info().rss * 1e-6
            if now > 0.0:  # a process that has just ended has none
                self.memory_mb = (now if self.memory_mb is None else self.memory_mb[0], now)

    def _check_services(self, running: list[_Running]) -> None:
        """Report once each service that has ended; the run continues without it."""
        for one in running:
            if not one.reported and not one.process.is_alive():
                one.reported = True
                self.requests.send(
                    Request.NOTE, f"{one.service.name} ended ({child.cause(one.process)}); the run goes on"
                )

    def _outcome(self, loop: BaseProcess, outcome_receiver: Connection) -> Scheduling:
        """The scheduling that the loop's process had. Raises the error that ended it, if any."""
        received: list[Any] = []
        while outcome_receiver.poll():
            try:
                received.append(outcome_receiver.recv())
            except EOFError:
                break
        loop.join()
        if loop.exitcode:
            reason = f"was ended: {self._killed}" if self._killed else f"died ({child.cause(loop)})"
            raise DriverError(f"the control loop's process {reason}: the servos are left to their watchdog")
        if received[-1] is not None:
            raise received[-1]
        return cast(Scheduling, received[0])


def _follow(service: Service) -> None:
    """A service's process: calls its function until SIGTERM, and then once more."""
    ended: list[int] = []
    signal.signal(signal.SIGTERM, lambda number, _frame: ended.append(number))
    follow = service.follow()
    while not ended:
        follow(False)
        time.sleep(_POLL_S)
    follow(True)
