"""Live runs in real processes on virtual time, and acts that break them."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import psutil
import pytest

from flexmotion.configs.robot import Robot, load_robot
from flexmotion.configs.stream import load_stream
from flexmotion.drivers.registry import create
from flexmotion.human.motion import Motion
from flexmotion.importers.default_clip import default_clip
from flexmotion.streamer.control.ladder import State
from flexmotion.streamer.control.run_trace import RunTrace
from flexmotion.streamer.motion.sources import ClipSource, Source
from flexmotion.streamer.run.requests import Request
from flexmotion.streamer.run.session import Session

from ..virtual_time import Costs, virtual_time

RATE = 125
NO_PLAN_S = 10.0
"""A run without a first plan after this time is ended [s of the loop]."""

_ON_THE_WALL_CLOCK = {"bench", "standing", "tab"}
"""Fixtures of tests on the wall clock."""


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark the tests on the wall clock."""
    for item in items:
        here = Path(__file__).parent in item.path.parents
        if here and isinstance(item, pytest.Function) and not _ON_THE_WALL_CLOCK.isdisjoint(item.fixturenames):
            item.add_marker(pytest.mark.wall_clock)


def _child_named(name: str, parent: int | None = None) -> psutil.Process:
    found = [p for p in psutil.Process(parent).children(recursive=True) if p.name() == name]
    assert len(found) == 1, f"{len(found)} processes are called {name}"
    return found[0]


@dataclass
class Live:
    """A finished live run.

    Attributes:
        acted_ns: when each act was done (`time.perf_counter_ns`).
    """

    session: Session
    record: RunTrace
    acted_ns: list[int] = field(default_factory=list)

    @property
    def states(self) -> list[State]:
        """Each state in turn."""
        states = [State(s) for s in self.record.state]
        return [s for k, s in enumerate(states) if not k or states[k - 1] is not s]

    def messages(self, kind: str) -> list[str]:
        """Messages of the events of a kind."""
        return [event.message for event in self.record.events if event.kind == kind]

    def ticks_until(self, state: State, act: int = 0) -> int:
        """Ticks that began after the action, up to the first one in `state`."""
        after = self.record.stamp_ns > self.acted_ns[act]
        return int(np.argmax(self.record.state[after] == state))

    def seconds_until(self, state: State, act: int = 0) -> float:
        """From an action to the first tick in `state` [s]."""
        rows = self.record.rows[self.record.state == state]
        return float((rows["stamp_ns"][rows["stamp_ns"] > self.acted_ns[act]][0] - self.acted_ns[act]) * 1e-9)

    @property
    def upright(self) -> bool:
        """Whether the torso is within 35 degrees of the vertical at the end (the rest pose leans forward)."""
        w, x, y, z = self.record.true_base[-1, 3:]
        return bool(1 - 2 * (x * x + y * y) > np.cos(np.radians(35)))


@pytest.fixture(scope="session")
def op3() -> Robot:
    return load_robot("op3")


@pytest.fixture(scope="session")
def steps() -> Motion:
    """The steps of the shipped motion, with half a second of standing before them."""
    return default_clip()[225:330]


Act = Callable[[Session], Request | None]


@pytest.fixture
def live(op3: Robot, steps: Motion) -> Callable[..., Live]:
    """Function (acts: [(seconds after the first plan, act)], end_s, ...) -> a whole run in processes, on virtual time.

    After the last act the run is ended in `end_s` seconds. The source is `steps` if none is given.
    """

    def run(
        acts: list[tuple[float, Act]],
        *,
        end_s: float = 3.0,
        stay: bool = True,
        source: Source | None = None,
        costs: Costs | None = None,
    ) -> Live:
        session = Session(
            op3,
            create("sim", op3),
            ClipSource(steps) if source is None else source,
            load_stream(),
            stay=stay,
            realtime=False,
            clock="real",
        )
        todo = sorted(acts, key=lambda act: act[0])
        acted: list[int] = []
        begin: list[float] = []

        def operate() -> Request | None:
            newest = session.telemetry.ticks.latest()
            if not begin and newest is not None and newest["plan"]:
                begin.append(time.perf_counter())
            if not begin:
                late = newest is not None and newest["tick"] > NO_PLAN_S * RATE
                return Request.END if late else None
            passed = time.perf_counter() - begin[0]
            if todo and passed >= todo[0][0]:
                acted.append(time.perf_counter_ns())
                return todo.pop(0)[1](session)
            last = acts[-1][0] if acts else 0.0
            return Request.END if not todo and passed > last + end_s else None

        session.next_request = operate
        with virtual_time(costs=costs):
            record = session.run()
        assert begin, f"no plan within {NO_PLAN_S:.0f} s"
        return Live(session, record, acted)

    return run


def _send(number: signal.Signals, name: str) -> Act:
    """An act: a signal to one of the run's processes."""

    def act(_session: Session) -> None:
        os.kill(_child_named(name).pid, number)

    return act


def _ask(request: Request) -> Act:
    """An act: a request that the loop takes on its next tick."""

    def act(session: Session) -> None:
        session.requests.send(request)

    return act


@pytest.fixture(scope="session")
def shared_memory() -> Callable[[], set[str]]:
    """Function () -> names of this machine's shared memory."""
    return lambda: {file.name for file in Path("/dev/shm").iterdir()}


@pytest.fixture(scope="session")
def child_named() -> Callable[..., psutil.Process]:
    """Function (name, parent=this one) -> its descendant that `ps` calls `name`."""
    return _child_named


@pytest.fixture(scope="session")
def send() -> Callable[..., Act]:
    """Function (signal, name of a process) -> an act."""
    return _send


@pytest.fixture(scope="session")
def ask() -> Callable[..., Act]:
    """Function (request) -> an act."""
    return _ask
