"""The planner's process: follows the loop's rows and makes the plan that is due, in time for its join."""

from __future__ import annotations

import time

import numpy as np

from flexmotion.configs.errors import FlexMotionError
from flexmotion.drivers.realtime import priority
from flexmotion.drivers.realtime.ring import Ring, shared_array
from flexmotion.streamer.control.tick_row import TickRow
from flexmotion.streamer.planning.replanning import Replanner
from flexmotion.streamer.run.requests import Request, RequestChannel

_POLL_S = 0.0005
"""Pause between two looks for a new row of the loop, or a new target [s]."""
_TOGETHER_S = 0.001
"""Pause after a target has come, for one right after it: its sender's process has a lower priority [s]."""
_PAUSE_S = 0.002
"""Pause before a target is considered again for which no plan could be made yet [s]."""


class Heartbeat:
    """Time and number of a process's signs of life, in shared memory."""

    def __init__(self) -> None:
        self._stamp = shared_array(2, np.int64)

    def beat(self) -> None:
        """Set the time to now."""
        self._stamp[0] = time.perf_counter_ns()
        self._stamp[1] += 1

    @property
    def beats(self) -> int:
        """How many there were."""
        return int(self._stamp[1])

    @property
    def stamp_ns(self) -> int:
        """When the last one was (`time.perf_counter_ns`); 0: none."""
        return int(self._stamp[0])

    def reset(self) -> None:
        """Forget the beats of an earlier process."""
        self._stamp[0] = 0

    @property
    def age_s(self) -> float | None:
        """Time since the last beat [s]; None before the first."""
        stamp = int(self._stamp[0])
        return (time.perf_counter_ns() - stamp) * 1e-9 if stamp else None


def serve(
    replanner: Replanner,
    ticks: Ring,
    rate_hz: float,
    requests: RequestChannel,
    heartbeat: Heartbeat,
    realtime: bool,
    succeeds: bool,
) -> None:
    """Plan until this process is ended, or until source or retargeter fail.

    Args:
        ticks: the loop's rows.
        requests: is sent a FAULT when planning fails.
        realtime: whether to ask for realtime scheduling.
        succeeds: another process planned before, and died: this one goes on from the plan that plays, or from a stand.
    """
    try:
        if succeeds:
            replanner.succeed()
        replanner.warm_up()
        priority.settle(collect=True)
        priority.claim(priority.PLANNER_PRIORITY, allowed=realtime)
        seen = 0
        while True:
            heartbeat.beat()
            count = ticks.count
            if count == seen and not replanner.has_target:
                time.sleep(_POLL_S)
                continue
            if replanner.ledger.has_new:
                time.sleep(_TOGETHER_S)
                count = ticks.count
            seen, latest = count, ticks.latest()
            if latest is None:
                time.sleep(_PAUSE_S)
                continue
            row = TickRow(latest)
            # The loop woke for its last tick at `stamp_ns`.
            since = (time.perf_counter_ns() - int(row.stamp_ns)) * 1e-9 * rate_hz
            made = replanner.step(int(row.tick) + 1 + int(since), 1.0 - since % 1.0)
            if not made and replanner.has_target and not replanner.gave_up:
                time.sleep(_PAUSE_S)
    except (FlexMotionError, ArithmeticError, ValueError, LookupError) as error:
        requests.send(Request.FAULT, f"{type(error).__name__}: {error}")
