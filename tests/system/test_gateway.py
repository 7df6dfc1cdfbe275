"""The gateway in real processes on virtual time: targets from outside, and its failures."""

from __future__ import annotations

import json
import os
import signal
import threading
import time
from collections.abc import Callable
from http.client import HTTPConnection
from typing import Any

import psutil
import pytest

from flexmotion.configs.errors import GatewayError
from flexmotion.configs.robot import Robot
from flexmotion.configs.stream import load_stream
from flexmotion.drivers.registry import create
from flexmotion.streamer.control.ladder import State
from flexmotion.streamer.gateway.client import Client
from flexmotion.streamer.gateway.listening import Listening, listen
from flexmotion.streamer.gateway.ports import any_free
from flexmotion.streamer.motion.intents import Text
from flexmotion.streamer.motion.model_source import ModelSource
from flexmotion.streamer.motion.script import Item
from flexmotion.streamer.run.requests import Request
from flexmotion.streamer.run.session import Session

from ..streamer.stub_sampler import StubSampler
from ..virtual_time import virtual_time
from ..waiting import HANGING_S

MOST_S = 120.0
"""Bound against hanging [s of the robot]."""

Child = Callable[[str], psutil.Process]


class Outside:
    """What another program does, in a thread: virtual time does not wait for it.

    Attributes:
        told: what it returned; None until then.
    """

    def __init__(self, act: Callable[[], Any]) -> None:
        self.told: Any = None
        self._act = act
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def _run(self) -> None:
        for _ in range(1000):  # until the server has loaded
            try:
                self.told = self._act()
                return
            except (OSError, GatewayError):
                threading.Event().wait(0.1)


def live(op3: Robot, steps: Callable[[Session, Listening], Any]) -> tuple[Session, list[str]]:
    """A run that listens; `steps` is a generator that yields until it has seen what it waits for."""
    source = ModelSource(StubSampler(), [Item(0.0, Text("stand still"))], "model:stub")  # type: ignore[arg-type]
    session = Session(op3, create("sim", op3), source, load_stream(), stay=True, realtime=False, clock="real")
    listening = Listening(port=any_free(), stop_port=any_free())
    listen(session, listening)
    going, ended = steps(session, listening), [False]

    def operate() -> Request | None:
        assert session.state.time_s < MOST_S, "what the test waits for does not happen"
        if not ended[0] and next(going, "over") == "over":
            ended[0] = True
            return Request.END
        return None

    session.next_request = operate
    with virtual_time(fastest=1.0):  # a program outside has the time that it would have
        session.run()
    return session, [event.message for event in session.record.events]


@pytest.fixture(scope="module")
def stopped_by_a_dead_gateway(op3: Robot, child_named: Child) -> tuple[Session, list[str], dict[str, Any]]:
    seen: dict[str, Any] = {}

    def steps(session: Session, listening: Listening) -> Any:
        while session.state.ladder is not State.STREAMING:
            yield
        assert listening.port is not None

        def turn() -> Any:
            with Client(port=listening.port or 0) as client:
                return client.velocity(0.0, 0.0, 0.3, ttl_s=2.0)

        turning = Outside(turn)
        while turning.told is None:
            yield
        seen["answer"] = turning.told
        child_named("fm-gateway").kill()
        seen["killed"] = session.state.tick
        while session.state.ladder is not State.HOLD:
            yield
        seen["held"] = session.state.tick

    session, messages = live(op3, steps)
    return session, messages, seen


def test_a_target_from_outside_is_followed(
    stopped_by_a_dead_gateway: tuple[Session, list[str], dict[str, Any]],
) -> None:
    session, _, seen = stopped_by_a_dead_gateway
    assert seen["answer"].state == "accepted"
    record = session.record
    followed = record.ticks.tick[record.ticks.target == seen["answer"].target]
    assert followed[0] == seen["answer"].tick


def test_a_gateway_that_is_killed_ends_its_velocity_and_nothing_else(
    stopped_by_a_dead_gateway: tuple[Session, list[str], dict[str, Any]],
) -> None:
    session, messages, seen = stopped_by_a_dead_gateway
    assert any("gateway ended (signal 9); the run goes on" in message for message in messages)
    assert any("is over after 2 s" in message for message in messages)
    assert seen["killed"] < seen["held"] <= seen["answer"].tick + (2.0 + 2.5) * 125
    states = [State(state) for state in session.record.state]
    assert states[-1] is State.OFF and State.FAULT not in states
    record = session.record
    assert record.missed_deadlines == 0 and record.underruns == 0
    assert not [event for event in record.events if event.kind == "fault"]


def test_an_emergency_stop_works_while_the_gateway_stands_still(op3: Robot, child_named: Child) -> None:
    """The gateway's interpreter is stopped in the middle of what it does; the stop process is another one."""
    seen: dict[str, Any] = {}

    def steps(session: Session, listening: Listening) -> Any:
        while session.state.ladder is not State.STREAMING:
            yield
        os.kill(child_named("fm-gateway").pid, signal.SIGSTOP)

        def press() -> Any:
            connection = HTTPConnection("127.0.0.1", listening.stop_port or 0, timeout=HANGING_S)
            connection.request("POST", "/estop")
            return json.loads(connection.getresponse().read())

        seen["stopped"] = session.state.tick
        pressing = Outside(press)
        while pressing.told is None:
            yield
        seen["answer"] = pressing.told
        while session.state.ladder is not State.FAULT:
            yield

    begin = time.monotonic()
    session, messages = live(op3, steps)
    assert time.monotonic() - begin < HANGING_S
    answer = seen["answer"]
    assert answer["state"] == "accepted" and answer["tick"] >= seen["stopped"]
    rows = session.record.rows
    after = rows[rows["tick"] >= answer["tick"]]
    assert State(after["state"][0]) is State.HOLD and State(after["state"][-1]) is State.FAULT
    frozen = after[after["state"] == State.HOLD]
    assert (frozen["q_cmd"] == rows["q_cmd"][rows["tick"] == answer["tick"] - 1]).all()
    assert any("e-stop: frozen by an operator" in message for message in messages)
