"""The planner's process: watches what the loop tells and makes the plan that is due, in time for its join."""

from __future__ import annotations

import time

import numpy as np

from flexmotion.configs.errors import FlexMotionError
from flexmotion.drivers.realtime import priority
from flexmotion.drivers.realtime.ring import Ring, shared_array
from flexmotion.streamer.planning.replanning import Replanner
from flexmotion.streamer.run.requests import Request, RequestChannel

_LOOK_S = 0.002
"""How often it looks for something to do [s]."""


class Heartbeat:
    """Says that the planner is alive, through shared memory."""

    def __init__(self) -> None:
        self._stamp = shared_array(1, np.int64)

    def beat(self) -> None:
        """Be alive now."""
        self._stamp[0] = time.perf_counter_ns()

    @property
    def age_s(self) -> float:
        """Time since the last beat [s]; 0 before the first."""
        stamp = int(self._stamp[0])
        return (time.perf_counter_ns() - stamp) * 1e-9 if stamp else 0.0


def serve(
    replanner: Replanner, ticks: Ring, rate_hz: float, controls: RequestChannel, beat: Heartbeat, realtime: bool
) -> None:
    """Plan until this process is ended, or until source or retargeter fail: that is told through `controls`."""
    try:
        replanner.warm_up()
        priority.settle(collect=True)
        priority.claim(priority.PLANNER_PRIORITY, allowed=realtime)
        while True:
            beat.beat()
            status = ticks.latest()
            if status is None:
                time.sleep(_LOOK_S)
                continue
            # The tick that the loop does next: it woke for the last one at `stamp_ns`.
            since = (time.perf_counter_ns() - int(status["stamp_ns"])) * 1e-9
            if not replanner.step(int(status["tick"]) + 1 + int(since * rate_hz)):
                time.sleep(_LOOK_S)
    except (FlexMotionError, ArithmeticError, ValueError, LookupError) as error:
        controls.ask(Request.FAULT, f"{type(error).__name__}: {error}")
