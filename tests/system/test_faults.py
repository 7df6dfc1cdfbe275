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
from flexmotion.streamer.motion.intents import Text, Velocity
from flexmotion.streamer.motion.model_source import ModelSource
from flexmotion.streamer.motion.script import Item
from flexmotion.streamer.run.requests import Request
from flexmotion.streamer.run.session import Session

from ..streamer.stub_sampler import StubSampler

Live = Callable[..., Any]
Send = Callable[..., Any]
Ask = Callable[..., Any]

RATE = 125
LARGEST_CHANGE = 0.2
"""Of a goal from tick to tick [rad]: where a foot is first lifted its ankle is unloaded, by 0.14 to 0.152."""
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


def standing_human() -> ModelSource:
    """A source that follows targets."""
    return ModelSource(StubSampler(), [Item(0.0, Text("stand still"))], "model:stub")  # type: ignore[arg-type]


def turning(session: Session) -> None:
    """An act: the robot is to turn to the left."""
    session.targets.send(Velocity(0.0, 0.0, 0.3))


def test_a_planner_that_dies_in_mid_walk_is_started_again_and_follows_the_next_target(live: Live, send: Send) -> None:
    """A dead planner once left a robot that stood until its run was ended, whatever was asked of it."""
    run = live(
        [(0.5, turning), (2.5, send(signal.SIGKILL, "fm-planner")), (6.0, turning)],
        end_s=4.0,
        source=standing_human(),
    )
    again = "it is started again (1 of 3), the robot stands until a new target"
    assert run.messages("fault") == [f"the planner's process died (signal 9); {again}"]
    assert "the planner runs again" in run.messages("note")
    rows = run.record.rows
    streaming = State.STREAMING
    between = (rows["stamp_ns"] > run.acted_ns[1]) & (rows["stamp_ns"] < run.acted_ns[2])
    held = rows["state"][between] == State.HOLD
    # It came to a stand, and stood until the target.
    assert held[-RATE:].all()
    after = rows[rows["stamp_ns"] > run.acted_ns[2]]
    assert (after["state"] == streaming).any() and after["target"].max() > rows["target"][between].max()
    assert after["steps_planned"][-1] > after["steps_planned"][0]
    changes = np.abs(np.diff(rows["q_cmd"], axis=0))
    played = (rows["state"][1:] == streaming) & (rows["state"][:-1] == streaming)
    assert changes[played].max() < LARGEST_CHANGE
    assert run.states[-1] is State.OFF and run.upright
    assert run.record.violations_sent == 0 and run.record.missed_deadlines == 0


def test_what_is_asked_while_there_is_no_planner_is_refused(live: Live, send: Send) -> None:
    """A new planner reads the targets that the old one had, too: none of them may move the robot."""
    run = live(
        [(0.5, turning), (2.5, send(signal.SIGKILL, "fm-planner")), (2.52, turning), (5.0, lambda _session: None)],
        end_s=1.5,
        source=standing_human(),
    )
    first, second = run.session.heard[-2:]
    assert first.state == "accepted"
    assert second.state == "refused" and "the planner was started again" in str(second.reason)
    late = run.record.rows[run.record.stamp_ns > run.acted_ns[3]]
    assert State.STREAMING not in late["state"] and run.upright


def test_a_planner_that_dies_again_and_again_is_given_up(live: Live, send: Send) -> None:
    kill = send(signal.SIGKILL, "fm-planner")
    run = live([(0.5 + k, kill) for k in range(4)], end_s=2.0, source=standing_human())
    faults = run.messages("fault")
    assert len(faults) == 4 and faults[-1].endswith("it was started 3 times again, no more")
    assert run.states[-3:] == [State.HOLD, State.PARK, State.OFF] and run.upright


def test_a_planner_that_hangs_is_ended_and_started_again(live: Live, send: Send) -> None:
    run = live(
        [(0.5, turning), (2.0, send(signal.SIGSTOP, "fm-planner")), (15.0, turning)],
        end_s=3.0,
        source=standing_human(),
    )
    silent, ended = run.messages("fault")
    assert silent == "the planner has not run for 0.6 s"
    assert ended.startswith("the planner has not run for 10 s and was ended; it is started again (1 of 3)")
    assert run.session.heard[-1].state == "accepted" and run.upright


def test_a_planner_that_is_stopped_for_three_seconds_follows_again(live: Live, send: Send) -> None:
    """Velocities end meanwhile, and the robot comes to a stand by the plan's own stop."""

    def briefly(session: Session) -> None:
        session.targets.send(Velocity(0.0, 0.0, 0.3), holds_s=2.0)

    run = live(
        [
            (0.5, briefly),
            (1.5, send(signal.SIGSTOP, "fm-planner")),
            (4.5, send(signal.SIGCONT, "fm-planner")),
            (6.0, turning),
        ],
        end_s=2.0,
        source=standing_human(),
    )
    assert run.messages("fault") == ["the planner has not run for 0.6 s"]
    stopped = (run.record.stamp_ns > run.acted_ns[2]) & (run.record.stamp_ns < run.acted_ns[3])
    assert (run.record.state[stopped][-RATE // 2 :] == State.HOLD).all()
    assert run.session.heard[-1].state == "accepted" and run.upright
    assert run.record.violations_sent == 0 and run.record.missed_deadlines == 0


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
