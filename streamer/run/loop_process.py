"""The control loop's process: realtime scheduling and absolute deadlines; it waits for no other process."""

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
    loop: ControlLoop, lifecycle: Lifecycle, channels: Sequence[RequestChannel], realtime: bool, outcome: Connection
) -> None:
    """Open the driver, tick until the run is over, close the driver.

    Args:
        channels: requests from other processes.
        realtime: whether to ask for realtime scheduling.
        outcome: is sent the scheduling that was granted, then the error that ended the run or None.
    """
    # The supervisor has died: an orderly end. Taken before the next tick, since a handler may interrupt one anywhere.
    signalled: list[Request] = []
    signal.signal(signal.SIGTERM, lambda _number, _frame: signalled.append(Request.END))
    error: Exception | None = None
    try:
        with loop.driver:
            loop.touch()
            # Locking memory takes long inside the kernel: done before this process has a priority that delays others.
            priority.settle(collect=False)
            outcome.send(priority.claim(priority.LOOP_PRIORITY, allowed=realtime))
            _run(loop, lifecycle, channels, signalled)
    except FlexMotionError as failure:
        error = failure
    except Exception as failure:  # of any kind: the supervisor must report it and the log must hold it
        error = DriverError(f"the control loop failed, torque is off: {type(failure).__name__}: {failure}")
    if error is not None:
        loop.telemetry.emit(loop.tick_count, "fault", str(error))
    with contextlib.suppress(BrokenPipeError):  # the supervisor has died
        outcome.send(error)


def _run(loop: ControlLoop, lifecycle: Lifecycle, channels: Sequence[RequestChannel], signalled: list[Request]) -> None:
    readers = [channel.reader() for channel in channels]
    row = loop.telemetry.row
    ticker = Ticker(1.0 / loop.robot.rate_hz)
    while not lifecycle.finished:
        ticker.wait()
        row.missed_deadlines += ticker.missed
        # Skip, never shift in time: the plan has continued meanwhile, as the robot has.
        loop.tick_count += ticker.skipped
        while signalled:
            lifecycle.request(signalled.pop())
        for reader in readers:
            for request, reason in reader.read():
                lifecycle.request(request, reason)
        lifecycle.step()
        loop.tick(ticker.late_ns)
