"""Targets in a whole run in lockstep: when the robot does what was asked, stands, and goes on."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from pathlib import Path

import numpy as np
import pytest

from flexmotion.configs.robot import load_robot
from flexmotion.configs.stream import load_stream
from flexmotion.drivers.registry import create
from flexmotion.human.motion import Motion
from flexmotion.streamer.control.ladder import State
from flexmotion.streamer.motion.heard import Heard, heard_since
from flexmotion.streamer.motion.intents import Stop, Text, Velocity, Waypoint
from flexmotion.streamer.motion.model_source import ModelSource
from flexmotion.streamer.motion.script import Item
from flexmotion.streamer.run.requests import Request
from flexmotion.streamer.run.session import Session

from ..stub_sampler import StubSampler

TURN = Velocity(0.0, 0.0, 0.3)
TURNS = 0.1
"""Speed above which the torso turns [rad/s]; it takes a second to reach the speed that was asked for."""
MOST_S = 20.0
"""Bound against hanging [s of the robot]."""


class Live:
    """A session that stands, with the answers to its targets, `told`, and their `newest` versions."""

    def __init__(self, *items: Item, clips: Mapping[str, Motion] | None = None, folder: str | Path = "op3") -> None:
        robot = load_robot(folder)
        source = ModelSource(StubSampler(), [Item(0.0, Text("stand still")), *items], "model:stub", clips=clips)  # type: ignore[arg-type]
        self.session = Session(robot, create("sim", robot, seed=0), source, load_stream())
        self._reader = self.session.heard_channel.reader()
        self.told: dict[int, Heard] = {}
        self.newest: dict[int, Heard] = {}

    def until(self, happens: Callable[[], object], what: str) -> int:
        """Step until it happens; returns the number of ticks."""
        for ticks in range(int(MOST_S * 125)):
            if happens():
                return ticks
            assert self.session.step(), f"the run ended before {what}"
            for answer in heard_since(self._reader):
                ended = answer.over or any(step.end is not None for step in answer.steps)
                assert answer.id not in self.told or answer.holds or answer.dropped or ended, "answered twice"
                self.told.setdefault(answer.id, answer)
                self.newest[answer.id] = answer
        raise AssertionError(f"waited {MOST_S:g} s of the robot for {what}")

    def until_state(self, state: State) -> int:
        return self.until(lambda: self.session.state.ladder is state, state.name)

    def until_answered(self, target: int) -> Heard:
        self.until(lambda: target in self.told, f"the answer to target {target}")
        return self.told[target]

    def yaw_speed(self) -> float:
        """Turn of the planned torso over the last half second [rad/s]."""
        base = self.session.record.base_ref[-63:, 3:]
        yaw = np.unwrap(2 * np.arctan2(base[:, 3], base[:, 0]))
        return float(yaw[-1] - yaw[0]) * 2.0


@pytest.fixture
def live() -> Iterator[Live]:
    one = Live()
    with one.session:
        one.until_state(State.STREAMING)
        yield one


def test_a_velocity_that_is_not_renewed_ends_in_a_stand_and_the_next_target_goes_on(live: Live) -> None:
    session = live.session
    target = session.send(TURN, holds_s=1.0)
    assert live.until_answered(target.id).state == "accepted"
    session.advance(0.8)
    assert live.yaw_speed() > TURNS
    ticks = live.until_state(State.HOLD)
    assert ticks <= 2.5 * 125
    session.advance(1.0)
    assert session.state.ladder is State.HOLD and abs(live.yaw_speed()) < 0.01
    again = session.send(TURN)
    accepted = live.until_answered(again.id)
    assert accepted.state == "accepted" and accepted.tick
    live.until_state(State.STREAMING)
    session.advance(1.0)
    assert live.yaw_speed() > TURNS
    session.finish()
    assert session.record.underruns == 0 and not [e for e in session.record.events if e.kind == "fault"]


def test_a_waypoint_whose_time_to_live_was_over_was_told_as_stopped(live: Live) -> None:
    """Its end, and that of every motion with an amount, was "stopped" instead of "expired"."""
    target = live.session.send(Waypoint(3.0, 0.0), holds_s=2.0)
    assert live.until_answered(target.id).state in ("accepted", "slowed")
    live.until_state(State.HOLD)
    (step,) = live.newest[target.id].steps
    assert step.end == "expired" and step.place is not None


def test_a_stop_holds_until_clear_and_what_was_asked_before_it_does_not_go_on(live: Live) -> None:
    """A robot that had been stopped walked on, by its old target, when the stop was released."""
    session = live.session
    live.until_answered(session.send(TURN).id)
    session.advance(1.0)
    session.ask(Request.STOP)
    live.until_state(State.HOLD)
    refused = live.until_answered(session.send(TURN).id)
    assert refused.state == "refused" and "release the stop first" in str(refused.reason)
    session.ask(Request.CLEAR)
    session.advance(1.0)
    assert session.state.ladder is State.HOLD and abs(live.yaw_speed()) < 0.01
    assert not session.record.ticks.must_stop[-1]
    assert live.until_answered(session.send(TURN).id).state == "accepted"
    live.until_state(State.STREAMING)
    session.finish()


def test_a_clear_while_the_robot_still_comes_to_a_stand_changes_nothing(live: Live) -> None:
    session = live.session
    live.until_answered(session.send(TURN).id)
    session.advance(0.5)
    session.ask(Request.STOP)
    session.advance(0.05)
    session.ask(Request.CLEAR)
    live.until_state(State.HOLD)
    assert session.record.ticks.must_stop[-1]
    refused = [event.message for event in session.record.events if event.kind == "refused"]
    assert len(refused) == 1 and refused[0].startswith("CLEAR: in STREAMING it changes nothing")
    session.finish()


def test_a_stick_that_is_held_makes_no_more_plans_than_one_message(live: Live) -> None:
    """Each of ten velocities a second cut the motion and was sampled anew."""
    session = live.session
    live.until_answered(session.send(TURN, holds_s=0.5).id)
    session.advance(0.5)
    before = session.plans.newest_id
    for _ in range(20):
        session.send(TURN, holds_s=0.5)
        session.advance(0.1)
    assert session.plans.newest_id - before <= 2.0 / session.settings.replan_s + 1
    assert live.yaw_speed() > TURNS
    assert {answer.state for answer in live.told.values()} == {"accepted"}
    session.finish()


def test_a_target_after_the_end_was_asked_for_is_refused(live: Live) -> None:
    session = live.session
    session.ask(Request.END)
    session.advance(0.1)
    assert live.until_answered(session.send(Stop()).id).state == "refused"
    session.finish()
