"""The control loop's process: realtime scheduling, absolute deadlines, nobody to wait for."""

from __future__ import annotations

import contextlib
import signal
from collections.abc import Sequence
from multiprocessing.connection import Connection

from flexmotion.configs.errors import DriverError, FlexMotionError
from flexmotion.drivers.realtime import priority
from flexmotion.drivers.realtime.ticker import Ticker
from flexmotion.streamer.control.loop import ControlLoop
from flexmotion.streamer.run.lifecycle import Lifecycle
from flexmotion.streamer.run.requests import Request, RequestChannel


def serve(
    loop: ControlLoop, lifecycle: Lifecycle, controls: Sequence[RequestChannel], realtime: bool, outcome: Connection
) -> None:
    """Open the driver, tick until the run is over, close the driver.

    Sends through `outcome` the scheduling that was granted, then the error that ended the run or None.
    """
    # Its supervisor has died: an orderly end. Heard at the next tick, since a handler may interrupt one anywhere.
    signalled: list[Request] = []
    signal.signal(signal.SIGTERM, lambda _number, _frame: signalled.append(Request.END))
    error: Exception | None = None
    try:
        with loop.driver:
            loop.touch()
            # Locking memory takes long inside the kernel: not yet at a priority that keeps everybody else waiting.
            priority.settle(collect=False)
            outcome.send(priority.claim(priority.LOOP_PRIORITY, allowed=realtime))
            _tick(loop, lifecycle, controls, signalled)
    except FlexMotionError as failure:
        error = failure
    except Exception as failure:  # whatever it is, the supervisor must learn of it, and so must the log
        error = DriverError(f"the control loop failed, torque is off: {type(failure).__name__}: {failure}")
    if error is not None:
        loop.telemetry.tell(loop.tick_count, "fault", str(error))
    with contextlib.suppress(BrokenPipeError):  # it has died
        outcome.send(error)


def _tick(
    loop: ControlLoop, lifecycle: Lifecycle, controls: Sequence[RequestChannel], signalled: list[Request]
) -> None:
    listeners = [one.listener() for one in controls]
    row = loop.telemetry.row
    ticker = Ticker(1.0 / loop.robot.rate_hz)
    while not lifecycle.finished:
        ticker.wait()
        row["missed_deadlines"] += ticker.missed
        # Clamp, never re-time: the plan has gone on meanwhile, as the robot has.
        loop.tick_count += ticker.skipped
        while signalled:
            lifecycle.hear(signalled.pop())
        for listener in listeners:
            for request, reason in listener.heard():
                lifecycle.hear(request, reason)
        lifecycle.act()
        loop.tick(ticker.late_ns)
