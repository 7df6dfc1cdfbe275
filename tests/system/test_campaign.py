"""The failure campaign that a robot's daemon must stand: floods, slow readers, a gateway that hangs, no robot.

Other parts of it: `test_faults.py` (planner, clock), `test_gateway.py` (a dead gateway), `tests/streamer/log`
(full disk, locks), `tests/streamer/gateway` (random bytes, every message); docs/live.md lists the ends.
"""

from __future__ import annotations

import json
import os
import signal
import socket
import threading
import time
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import psutil
import pytest
from websockets.sync.client import connect

from flexmotion.configs.errors import DriverError
from flexmotion.configs.robot import Robot
from flexmotion.configs.stream import load_stream
from flexmotion.drivers.registry import create
from flexmotion.drivers.sim.driver import SimDriver
from flexmotion.drivers.sim.process import SimProcess
from flexmotion.streamer.control.ladder import State
from flexmotion.streamer.gateway.listening import Listening
from flexmotion.streamer.motion.intents import Text
from flexmotion.streamer.motion.model_source import ModelSource
from flexmotion.streamer.motion.script import Item
from flexmotion.streamer.run.requests import Request
from flexmotion.streamer.run.session import Session

from ..streamer.stub_sampler import StubSampler
from ..virtual_time import virtual_time
from ..waiting import HANGING_S
from .test_gateway import Outside, live

FLOOD = 2000
"""Messages of the flood, sent without waiting for answers."""
ABSENT = 3
"""Attempts to open the driver before the robot is there."""
WATCHDOG_S, OPENING_S = 4.0, 20.0
"""Of the service manager, and of a bus that takes long to open [s of the run]."""


def unharmed(session: Session) -> None:
    """The loop has not noticed: no missed deadline, no goal outside the envelope, no fault, no fall."""
    record = session.record
    assert record.missed_deadlines == 0 and record.violations_sent == 0
    assert [event.message for event in record.events if event.kind == "fault"] == []
    states = {State(state) for state in record.state}
    assert not states & {State.DAMPED, State.FAULT} and State(record.state[-1]) is State.OFF


def test_a_flood_is_answered_message_by_message_and_the_loop_does_not_notice(op3: Robot) -> None:
    """Turning velocities faster than any plan, a page that reads nothing, and a client that reads no answer."""
    seen: dict[str, Any] = {}

    def steps(session: Session, listening: Listening) -> Any:
        while session.state.ladder is not State.STREAMING:
            yield
        random = np.random.default_rng(0)
        turns = [round(float(random.uniform(-0.4, 0.4)), 3) for _ in range(FLOOD)]

        def flood() -> Counter[str]:
            states: Counter[str] = Counter()
            address = f"ws://127.0.0.1:{listening.port}/targets"
            # Small buffers: what these two do not read fills them soon.
            with connect(address + "?page=1&status=50", max_queue=1), connect(address) as client:
                reading = threading.Thread(target=read, args=(client, states))
                reading.start()
                for number, turn in enumerate(turns):
                    message = {"type": "velocity", "velocity": [0.0, 0.0, turn], "ttl_s": 1.0, "id": str(number)}
                    client.send(json.dumps({**message, "source": "flood"}))
                reading.join(HANGING_S)
            return states

        def read(client: Any, states: Counter[str]) -> None:
            while states.total() < FLOOD:
                told = json.loads(client.recv(HANGING_S))
                if told["type"] == "answer":
                    states[told["state"]] += 1

        flooding = Outside(flood)
        while flooding.told is None:
            yield
        seen["states"] = flooding.told
        while session.state.ladder is not State.HOLD:  # the last velocity ends after its second
            yield

    session, _ = live(op3, steps)
    states = seen["states"]
    assert states.total() == FLOOD and states["superseded"] > FLOOD / 2
    assert states["accepted"] + states["slowed"] >= 1 and set(states) <= {
        *("accepted", "slowed", "superseded", "expired", "refused"),
    }
    unharmed(session)


def test_a_gateway_that_hangs_ends_its_velocity_and_answers_when_it_goes_on(
    op3: Robot, child_named: Callable[[str], psutil.Process]
) -> None:
    seen: dict[str, Any] = {}

    def steps(session: Session, listening: Listening) -> Any:
        from flexmotion.streamer.gateway.client import Client

        while session.state.ladder is not State.STREAMING:
            yield
        client = Client(port=listening.port or 0)
        turning = Outside(lambda: client.velocity(0.0, 0.0, 0.3, ttl_s=2.0))
        while turning.told is None:
            yield
        gateway = child_named("fm-gateway").pid
        os.kill(gateway, signal.SIGSTOP)
        while session.state.ladder is not State.HOLD:
            yield
        os.kill(gateway, signal.SIGCONT)
        again = Outside(lambda: client.velocity(0.0, 0.0, -0.3, ttl_s=1.0))
        while again.told is None:
            yield
        seen["again"] = again.told
        for state in (State.STREAMING, State.HOLD):
            while session.state.ladder is not state:
                yield

    session, messages = live(op3, steps)
    assert seen["again"].state == "accepted"
    assert sum("is over after" in message for message in messages) == 2
    unharmed(session)


# ---------------------------------------------------------------- as a service


class AbsentRobot(SimProcess):
    """A simulated robot that is switched on after some attempts to reach it."""

    def __init__(self, robot: Robot) -> None:
        simulation = create("sim", robot)
        assert isinstance(simulation, SimDriver)
        super().__init__(simulation, realtime=False)
        self._attempts = 0

    def open(self) -> None:
        self._attempts += 1
        if self._attempts <= ABSENT:
            raise DriverError(f"port /dev/ttyUSB0: {'no such port' if self._attempts == 1 else 'no servo answers'}")
        super().open()


class SlowRobot(SimProcess):
    """A simulated robot whose bus takes long to open."""

    def __init__(self, robot: Robot) -> None:
        simulation = create("sim", robot)
        assert isinstance(simulation, SimDriver)
        super().__init__(simulation, realtime=False)

    def open(self) -> None:
        time.sleep(OPENING_S)
        super().open()


class Manager:
    """A service manager's socket."""

    def __init__(self, path: Path) -> None:
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self._socket.bind(str(path))
        self._socket.setblocking(False)
        self.lines: list[str] = []

    def look(self) -> list[str]:
        """All lines so far."""
        while True:
            try:
                self.lines += self._socket.recv(4096).decode().splitlines()
            except BlockingIOError:
                return self.lines


@pytest.fixture
def manager(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Manager:
    found = Manager(tmp_path / "notify")
    monkeypatch.setenv("NOTIFY_SOCKET", str(tmp_path / "notify"))
    monkeypatch.setenv("WATCHDOG_USEC", str(int(WATCHDOG_S * 1e6)))
    return found


def service(robot: Robot, driver: Any) -> Session:
    """A session as `flexmotion run --wait` has it."""
    source = ModelSource(StubSampler(), [Item(0.0, Text("stand still"))], "model:stub")  # type: ignore[arg-type]
    session = Session(robot, driver, source, load_stream(), stay=True, realtime=False, clock="real")
    session.waits = True
    return session


def test_a_robot_that_is_not_there_is_waited_for_and_the_manager_told(op3: Robot, manager: Manager) -> None:
    session = service(op3, AbsentRobot(op3))

    def operate() -> Request | None:
        manager.look()
        return Request.END if session.state.ladder is State.STREAMING else None

    session.next_request = operate
    with virtual_time():
        session.run()
    notes = [event.message for event in session.record.events if event.kind == "note"]
    assert notes[:3] == [
        "waiting for the robot: port /dev/ttyUSB0: no such port",
        "waiting for the robot: port /dev/ttyUSB0: no servo answers",
        "the robot answers",
    ]
    lines = manager.look()
    assert lines.count("READY=1") == 1 and "STATUS=waiting for the robot: port /dev/ttyUSB0: no servo answers" in lines
    assert "STATUS=STREAMING" in lines and "WATCHDOG=1" in lines and lines.count("STOPPING=1") == 1
    assert State(session.record.state[-1]) is State.OFF


def test_the_watchdog_waits_for_a_bus_that_takes_long_to_open(op3: Robot, manager: Manager) -> None:
    """The manager ended a daemon whose bus took longer to open than the watchdog's time."""
    session = service(op3, SlowRobot(op3))
    fed: list[float] = []

    def operate() -> Request | None:
        seen = len(fed)
        fed.extend([time.perf_counter()] * (manager.look().count("WATCHDOG=1") - seen))
        return Request.END if session.state.ladder is State.STREAMING else None

    session.next_request = operate
    with virtual_time():
        session.run()
    gaps = [after - before for before, after in zip(fed, fed[1:], strict=False)]
    assert fed[-1] - fed[0] > OPENING_S - WATCHDOG_S and max(gaps) < WATCHDOG_S


def test_an_arm_while_the_robot_is_away_is_refused_and_not_kept(op3: Robot, manager: Manager) -> None:
    """It was kept: the robot stood up minutes later, when somebody switched its supply on."""
    session = service(op3, AbsentRobot(op3))
    session.armed, session.attended = False, True
    asked: list[Request] = []

    def operate() -> Request | None:
        if not asked and any("no such port" in line for line in manager.look()):
            asked.append(Request.ARM)
            return Request.ARM
        return Request.END if asked and session.state.tick > 60 else None

    session.next_request = operate
    with virtual_time():
        session.run()
    assert "ARM: the robot is not there yet" in [event.message for event in session.record.events]
    assert session.record.used > 60 and (session.record.state == State.OFF).all()


def test_the_end_is_taken_while_the_robot_is_waited_for(op3: Robot, manager: Manager) -> None:
    driver = AbsentRobot(op3)
    driver._attempts = -10_000
    session = service(op3, driver)

    def operate() -> Request | None:
        return Request.END if "READY=1" in manager.look() else None

    session.next_request = operate
    with virtual_time():
        session.run()
    assert session.record.used == 0 and "STOPPING=1" in manager.look()


def test_a_loop_that_stands_still_does_not_feed_the_watchdog(
    op3: Robot, manager: Manager, child_named: Callable[[str], psutil.Process]
) -> None:
    session = service(op3, create("sim", op3))
    session.waits = False
    fed: list[int] = []

    def operate() -> Request | None:
        lines = manager.look()
        if session.state.ladder is State.STREAMING and not fed and lines.count("WATCHDOG=1") > 3:
            os.kill(child_named("fm-loop").pid, signal.SIGSTOP)
            fed.append(lines.count("WATCHDOG=1"))
        return None

    session.next_request = operate
    with virtual_time(), pytest.raises(DriverError, match="it did not tick for 2 s"):
        session.run()
    # At most for the ticks before the signal; the loop stood still for two of the watchdog's quarters.
    assert fed and manager.look().count("WATCHDOG=1") <= fed[0] + 1
