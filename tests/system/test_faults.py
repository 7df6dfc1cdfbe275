"""Processes that die or stop in mid-walk, and a clock that jumps: what the robot does then."""

from __future__ import annotations

import signal
import time
from collections.abc import Callable
from typing import Any

import numpy as np
import psutil
import pytest

from flexmotion.configs.errors import DriverError
from flexmotion.streamer.control.ladder import State
from flexmotion.streamer.run.requests import Request

Live = Callable[..., Any]
Send = Callable[..., Any]
Ask = Callable[..., Any]

LOOKS_S = 0.06
"""The supervisor looks every 20 ms; three of them."""
MID_WALK = 1.9
"""Seconds after the first plan at which a foot is in the air, or nearly."""


@pytest.mark.parametrize("at", [0.4, MID_WALK, 2.6])
def test_a_planner_that_is_killed_leaves_a_robot_that_stands(live: Live, send: Send, at: float) -> None:
    run = live([(at, send(signal.SIGKILL, "fm-planner"))])
    assert State.HOLD in run.states and State.DAMPED not in run.states
    # It stood until the operator ended the run.
    assert run.states[-3:] == [State.HOLD, State.PARK, State.OFF] and run.upright
    assert run.messages("fault") == ["the planner's process died (signal 9)"]
    assert run.record.underruns == 1 and run.record.violations_sent == 0


def test_a_planner_that_is_stopped_and_goes_on_is_used_again(live: Live, send: Send) -> None:
    run = live(
        [(0.9, send(signal.SIGSTOP, "fm-planner")), (4.5, send(signal.SIGCONT, "fm-planner"))],
        end_s=4.0,
    )
    assert run.messages("fault") == ["the planner has not run for 0.6 s"]
    assert "the planner runs again" in run.messages("note")
    walked = [State.STREAMING, State.HOLD, State.STREAMING, State.HOLD, State.PARK, State.OFF]
    assert run.states[-6:] == walked and run.upright
    assert run.record.violations_sent == 0


def test_a_run_that_should_end_by_itself_does_not_wait_for_a_dead_planner(live: Live, send: Send) -> None:
    run = live([(MID_WALK, send(signal.SIGKILL, "fm-planner"))], stay=False, end_s=60.0)
    assert run.states[-2:] == [State.PARK, State.FAULT] and run.upright
    assert any("no plan for 5 s" in message for message in run.messages("fault"))


def test_a_robot_that_dies_is_a_fault_within_200_ms(live: Live, send: Send) -> None:
    run = live([(MID_WALK, send(signal.SIGKILL, "fm-robot"))])
    assert run.states[-1] is State.FAULT
    assert run.ticks_until(State.FAULT) <= 0.2 * run.record.rate_hz
    assert any("no joint has answered" in message for message in run.messages("fault"))


@pytest.mark.parametrize(
    ("number", "within_s", "message"),
    [(signal.SIGSTOP, 2.0, "it did not tick for 2 s"), (signal.SIGKILL, 0.0, r"died \(signal 9\)")],
    ids=["hangs", "killed"],
)
def test_a_loop_that_is_gone_is_noticed_in_time(
    live: Live, send: Send, number: signal.Signals, within_s: float, message: str
) -> None:
    """Within one look of the supervisor after the time that the loop has; no process is left."""
    seen: list[str] = []
    acts = [
        (MID_WALK, send(number, "fm-loop")),
        (MID_WALK + within_s - 0.1, lambda _session: seen.append("before")),
        (MID_WALK + within_s + LOOKS_S, lambda _session: seen.append("after")),
    ]
    with pytest.raises(DriverError, match=message):
        live(acts, end_s=60.0)
    assert seen == ["before"]
    left = {process.name() for process in psutil.Process().children(recursive=True)}
    assert not left & {"fm-loop", "fm-planner", "fm-robot"}


def test_an_emergency_stop_freezes_the_goals_within_two_periods(live: Live, ask: Ask) -> None:
    run = live([(MID_WALK, ask(Request.ESTOP))])
    after = np.flatnonzero(run.record.stamp_ns > run.acted_ns[0])
    frozen = run.record.q_cmd[after[1] : after[1] + 40]
    np.testing.assert_array_equal(frozen, np.broadcast_to(frozen[0], frozen.shape))
    assert run.states[-3:] == [State.HOLD, State.PARK, State.FAULT] and run.upright
    assert run.messages("fault")[0].endswith("e-stop: frozen by an operator")


def test_a_stop_in_mid_walk_ends_standing(live: Live, ask: Ask) -> None:
    run = live([(MID_WALK, ask(Request.STOP))])
    assert run.states[-4:] == [State.STREAMING, State.HOLD, State.PARK, State.OFF] and run.upright
    assert run.seconds_until(State.HOLD) < 2.5
    assert run.messages("fault") == [] and run.record.underruns == 0


def test_a_wall_clock_that_jumps_by_an_hour_changes_nothing(live: Live, monkeypatch: pytest.MonkeyPatch) -> None:
    """An hour forward, then an hour back, in every process: nothing that moves the robot reads that clock."""
    real, begin = time.time, time.perf_counter()

    def jumping() -> float:
        return real() + (3600.0 if int(time.perf_counter() - begin) % 2 else -3600.0)

    monkeypatch.setattr(time, "time", jumping)
    monkeypatch.setattr(time, "time_ns", lambda: int(jumping() * 1e9))
    run = live([(3.0, lambda _session: None)], end_s=1.5)
    assert run.states == [State.READY, State.STREAMING, State.HOLD, State.PARK, State.OFF] and run.upright
    assert run.messages("fault") == [] and run.record.underruns == 0
