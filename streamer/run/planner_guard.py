"""`PlannerGuard`: starts the planner's process, notices when it dies or stands still, and starts it again."""

from __future__ import annotations

import time
from multiprocessing.process import BaseProcess

from flexmotion.drivers.realtime import child
from flexmotion.drivers.realtime.ring import Ring
from flexmotion.streamer.planning.replanning import Replanner
from flexmotion.streamer.run import planner_process
from flexmotion.streamer.run.planner_process import Heartbeat
from flexmotion.streamer.run.requests import Request, RequestChannel

_SILENT_S = 0.6
"""A planner without a heartbeat for this long is reported [s]."""
_HUNG_S = 10.0
"""A planner without a heartbeat for this long is ended, and counts as dead [s]."""
_OPENING_S = 30.0
"""A planner without a heartbeat this long after its start is ended, and counts as dead [s]. A slow machine takes 10 s
to load a bundle and warm up."""
MOST_RESTARTS = 3
"""In a run: a planner that dies again and again has a cause that a person must find."""


class PlannerGuard:
    """The supervisor's view of the planner's process.

    While there is no planner, the plan that plays ends in its own stop. A new one is started only in a run that follows
    targets: the robot then stands until a new target arrives, so that nothing goes on by itself after a failure.

    Args:
        replanner: the planner's side of the run, as it is before its process is started.
        ticks: the loop's rows.
        from_planner: requests of the planner's process.
        to_loop: channel on which failures are told to the loop.
        realtime: whether the process asks for realtime scheduling.
    """

    def __init__(
        self,
        replanner: Replanner,
        ticks: Ring,
        rate_hz: float,
        from_planner: RequestChannel,
        to_loop: RequestChannel,
        *,
        realtime: bool,
    ) -> None:
        self.heartbeat = Heartbeat()
        self._given = (replanner, ticks, rate_hz, from_planner, self.heartbeat, realtime)
        self._to_loop, self._restarts = to_loop, MOST_RESTARTS if replanner.follows_targets else 0
        self._started = 0
        self._silent = self._given_up = False
        self._process = self._start()

    def check(self) -> None:
        """Report a failure once to the loop, and start the planner again where that may be done."""
        if self._given_up:
            return
        if not self._process.is_alive():
            self._dead()
            return
        age_s = self.heartbeat.age_s
        if age_s is None:  # it is being started
            if time.perf_counter_ns() - self._started_ns > _OPENING_S * 1e9:
                self._hung(f"the planner did not begin to run within {_OPENING_S:g} s and was ended")
        elif age_s > _HUNG_S:
            self._hung(f"the planner has not run for {_HUNG_S:g} s and was ended")
        elif (age_s > _SILENT_S) != self._silent:
            self._silent = not self._silent
            if self._silent:
                self._to_loop.send(Request.LOST, f"the planner has not run for {_SILENT_S:g} s")
            else:
                self._to_loop.send(Request.NOTE, "the planner runs again")

    def end(self) -> None:
        """End the process."""
        child.end(self._process, patience_s=0.0)

    def _hung(self, failure: str) -> None:
        self._process.kill()
        self._process.join()
        self._restart(failure)

    def _dead(self) -> None:
        if self._process.exitcode:
            self._restart(f"the planner's process died ({child.cause(self._process)})")
        else:
            self._given_up = True  # it has said why it cannot go on: the run ends

    def _restart(self, failure: str) -> None:
        if not self._restarts:
            self._given_up = True
            self._to_loop.send(Request.GIVEN_UP, failure)
        elif self._started > self._restarts:
            self._given_up = True
            self._to_loop.send(Request.GIVEN_UP, f"{failure}; it was started {self._restarts} times again, no more")
        else:
            again = f"it is started again ({self._started} of {self._restarts}), the robot stands until a new target"
            self._to_loop.send(Request.LOST, f"{failure}; {again}")
            self._process = self._start()

    def _start(self) -> BaseProcess:
        self.heartbeat.reset()
        # It is told again that the planner runs, once the new one does.
        self._silent = self._started > 0
        self._started += 1
        self._started_ns = time.perf_counter_ns()
        return child.start("planner", planner_process.serve, *self._given, self._started > 1)
