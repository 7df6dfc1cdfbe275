"""The control loop's process: realtime scheduling and absolute deadlines; it waits for no other process."""

from __future__ import annotations

import contextlib
import signal
import time
from collections.abc import Sequence
from multiprocessing.connection import Connection

from flexmotion.configs.errors import DriverError, FlexMotionError
from flexmotion.drivers.realtime import priority
from flexmotion.drivers.realtime.ticker import Ticker
from flexmotion.streamer.control.ladder import State
from flexmotion.streamer.control.loop import ControlLoop
from flexmotion.streamer.run.blind_lowering import blind_lowering
from flexmotion.streamer.run.lifecycle import Lifecycle
from flexmotion.streamer.run.planner_process import Heartbeat
from flexmotion.streamer.run.requests import Request, RequestChannel, RequestReader

WAITING = "waiting for the robot:"
"""Begins the note about a robot that is not there."""

_RETRY_S, _LOOK_S = 1.0, 0.1
"""Time between two attempts to open the driver of a robot that is waited for, and between two looks at requests [s]."""


def serve(
    loop: ControlLoop,
    lifecycle: Lifecycle,
    channels: Sequence[RequestChannel],
    opening: Heartbeat | None,
    realtime: bool,
    outcome: Connection,
) -> None:
    """Open the driver, tick until the run is over, close the driver.

    Args:
        channels: requests from other processes.
        opening: the run waits for a robot that is not there, and beats with every attempt to reach it; None: it does
            not wait.
        realtime: whether to ask for realtime scheduling.
        outcome: is sent the scheduling that was granted, then the error that ended the run or None.
    """
    # The supervisor has died: an orderly end. Taken before the next tick, since a handler may interrupt one anywhere.
    signalled: list[Request] = []
    signal.signal(signal.SIGTERM, lambda _number, _frame: signalled.append(Request.END))
    error: Exception | None = None
    try:
        readers = [channel.reader() for channel in channels]
        if opening is None:
            loop.driver.open()
        elif not _await_robot(loop, lifecycle, readers, signalled, opening):
            outcome.send("other")
            outcome.send(None)
            return
        with contextlib.closing(loop.driver):
            loop.touch()
            # Locking memory takes long inside the kernel: done before this process has a priority that delays others.
            priority.settle(collect=False)
            outcome.send(priority.claim(priority.LOOP_PRIORITY, allowed=realtime))
            try:
                _run(loop, lifecycle, readers, signalled)
            except Exception as failure:
                _lower(loop, lifecycle, readers, signalled, failure)
                raise
    except FlexMotionError as failure:
        error = failure
    except Exception as failure:  # of any kind: the supervisor must report it and the log must hold it
        error = DriverError(f"the control loop failed: {type(failure).__name__}: {failure}")
    if error is not None:
        loop.telemetry.emit(loop.tick_count, "fault", str(error))
    with contextlib.suppress(BrokenPipeError):  # the supervisor has died
        outcome.send(error)


def _await_robot(
    loop: ControlLoop,
    lifecycle: Lifecycle,
    readers: Sequence[RequestReader],
    signalled: list[Request],
    opening: Heartbeat,
) -> bool:
    """Try to open the driver until the robot answers; returns whether it did before the end was requested.

    Torque stays as it is. Each new reason why the robot cannot be reached is told once.
    """
    told = ""
    while True:
        opening.beat()
        try:
            loop.driver.open()
        except DriverError as error:
            lifecycle.robot_answers = False
            if str(error) != told:
                told = str(error)
                loop.telemetry.emit(0, "note", f"{WAITING} {error}")
        else:
            lifecycle.robot_answers = True
            if told:
                loop.telemetry.emit(0, "note", "the robot answers")
            return True
        for _ in range(round(_RETRY_S / _LOOK_S)):
            time.sleep(_LOOK_S)
            _take(lifecycle, readers, signalled)
            if lifecycle.ending:
                return False


def _take(lifecycle: Lifecycle, readers: Sequence[RequestReader], signalled: list[Request]) -> None:
    """Take the requests that have arrived."""
    while signalled:
        lifecycle.request(signalled.pop())
    for reader in readers:
        for request, reason in reader.read():
            lifecycle.request(request, reason)


def _lower(
    loop: ControlLoop,
    lifecycle: Lifecycle,
    readers: Sequence[RequestReader],
    signalled: list[Request],
    failure: Exception,
) -> None:
    """Lower a robot whose loop has failed, without measurements; `close` then switches its torque off.

    A robot that has got no goal since its torque went on is still where it was without torque, and is left there.
    KILL, and a run that is to end at once, end the lowering too; all other requests change nothing any more. A driver
    that fails here too is closed at once.
    """
    if not loop.commands or loop.ladder.state not in (State.READY, State.STREAMING, State.HOLD, State.PARK):
        return
    loop.telemetry.emit(
        loop.tick_count,
        "fault",
        f"{loop.ladder.state.name} -> PARK: the control loop failed: {type(failure).__name__}: {failure}; "
        "the robot is lowered without measurements",
    )
    loop.driver.take_pins(loop.command.position)
    row, ticker = loop.telemetry.row, Ticker(1.0 / loop.robot.rate_hz)
    for goal in blind_lowering(loop.robot, loop.command.position.copy()):
        ticker.wait()
        _take(lifecycle, readers, signalled)
        if loop.inputs.kill or lifecycle.quit:
            return
        loop.command.position[:] = goal
        loop.driver.write(loop.command)
        loop.tick_count += 1
        # The supervisor ends a loop whose rows grow old.
        row.stamp_ns[...] = time.perf_counter_ns()
        row.tick[...], row.state[...], row.q_cmd[...] = loop.tick_count, State.PARK, goal
        loop.telemetry.commit()


def _run(loop: ControlLoop, lifecycle: Lifecycle, readers: Sequence[RequestReader], signalled: list[Request]) -> None:
    row = loop.telemetry.row
    ticker = Ticker(1.0 / loop.robot.rate_hz)
    while not lifecycle.finished:
        ticker.wait()
        row.missed_deadlines += ticker.missed
        # Skip, never shift in time: the plan has continued meanwhile, as the robot has.
        loop.tick_count += ticker.skipped
        _take(lifecycle, readers, signalled)
        lifecycle.step()
        loop.tick(ticker.late_ns)
