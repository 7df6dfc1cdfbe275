"""A loop and a planner that answer at once, so that a gateway can be tested without a robot."""

from __future__ import annotations

import socket
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Any

import pytest

from flexmotion.configs.robot import Robot, load_robot
from flexmotion.configs.stream import Gateway
from flexmotion.streamer.control.ladder import State
from flexmotion.streamer.control.telemetry import Telemetry
from flexmotion.streamer.gateway.admission import Admission
from flexmotion.streamer.gateway.desk import Desk
from flexmotion.streamer.gateway.messages import Answer
from flexmotion.streamer.gateway.ports import any_free
from flexmotion.streamer.gateway.service import GatewayService
from flexmotion.streamer.motion.heard import Heard, HeardChannel
from flexmotion.streamer.motion.heard import State as Fate
from flexmotion.streamer.motion.intents import Text
from flexmotion.streamer.motion.part_intents import Hand
from flexmotion.streamer.motion.targets import Target, TargetMailbox
from flexmotion.streamer.run.requests import Request, RequestChannel

from ...waiting import wait_until

JOINTS, RATE = 3, 125.0

Begin = Callable[..., GatewayService]


@dataclass
class Run:
    """Shared memory of a run; the test acts as planner and loop."""

    telemetry: Telemetry = field(default_factory=lambda: Telemetry(JOINTS, RATE))
    targets: TargetMailbox = field(default_factory=TargetMailbox)
    heard: HeardChannel = field(default_factory=HeardChannel)
    tick: int = 0
    state: State = State.STREAMING
    stopped: bool = False

    def __post_init__(self) -> None:
        self.inbox = self.targets.reader()

    def step(self) -> None:
        """Publish a row."""
        row = self.telemetry.row
        row.tick[...], row.state[...], row.must_stop[...] = self.tick, self.state, self.stopped
        row.stamp_ns[...] = time.perf_counter_ns()
        self.telemetry.commit()
        self.tick += 1

    def arrived(self) -> list[Target]:
        return self.inbox.read()

    def answer(
        self,
        target: int,
        state: Fate = "accepted",
        reason: str | None = None,
        heard: str | None = None,
        **holds: Any,
    ) -> None:
        tick = self.tick if state == "accepted" else None
        answer = Heard(id=target, asked="?", state=state, tick=tick, reason=reason, heard_as=heard, **holds)
        self.heard.publish(answer)

    def take(self, request: Request) -> None:
        """As the loop takes a request."""
        if request in (Request.STOP, Request.CLEAR):
            self.stopped = request is Request.STOP
        self.telemetry.emit(self.tick, "request", request.name)
        self.step()


@dataclass
class Office:
    """A desk with its run; answers are collected in order."""

    run: Run
    desk: Desk
    requests: RequestChannel
    told: list[Answer] = field(default_factory=list)

    def ask(self, text: str | bytes, sender: str = "a") -> None:
        self.desk.receive(text if isinstance(text, bytes) else text.encode(), self.told.append, sender)

    @property
    def states(self) -> list[str]:
        return [answer.state for answer in self.told]


@pytest.fixture(scope="session")
def op3() -> Robot:
    return load_robot("op3")


@pytest.fixture
def run() -> Run:
    return Run()


@pytest.fixture
def make_office(run: Run) -> Callable[..., Office]:
    """Function (fields of the settings) -> an office; without an interval of coalescing if none is given."""

    def make(**fields: object) -> Office:
        settings = Gateway.model_validate({"coalesce_s": 0.0, **fields})
        requests = RequestChannel()
        desk = Desk(settings, run.telemetry, run.targets.sender(), run.heard, requests)
        return Office(run, desk, requests)

    return make


class Answering:
    """A thread that answers as planner and loop do.

    Attributes:
        seen: targets in order; `requested`: requests in order.
    """

    def __init__(self, run: Run, channels: list[RequestChannel]) -> None:
        self.run, self.seen, self.requested = run, [], []
        self._channels = [channel.reader() for channel in channels]
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._serve, daemon=True)
        self._thread.start()

    seen: list[Target]
    requested: list[Request]

    def close(self) -> None:
        self._ended.set()
        self._thread.join()

    def _serve(self) -> None:
        while not self._ended.wait(0.002):
            self.run.step()
            for channel in self._channels:
                for request, _ in channel.read():
                    self.requested.append(request)
                    self.run.take(request)
            arrived = self.run.arrived()
            self.seen += arrived
            for target in arrived[:-1]:
                self.run.answer(target.id, "superseded")
            for target in arrived[-1:]:
                if self.run.stopped:
                    self.run.answer(target.id, "refused", "a stop is in force")
                elif isinstance(target.intent, Hand):
                    self.run.answer(target.id, heard=target.intent.part, holds="part")
                    self.run.answer(target.id, heard=target.intent.part, holds="part", there="0.3 cm from there")
                else:
                    self.run.answer(target.id, heard="wave" if isinstance(target.intent, Text) else None)


@pytest.fixture
def answering(run: Run) -> Iterator[Callable[..., Answering]]:
    """Function (channels) -> a thread that answers until the test is over."""
    begun: list[Answering] = []

    def begin(*channels: RequestChannel) -> Answering:
        begun.append(Answering(run, list(channels)))
        return begun[-1]

    yield begin
    for one in begun:
        one.close()


@pytest.fixture
def begin(run: Run, op3: Robot) -> Iterator[Begin]:
    """Function (token, fields of the settings) -> a gateway that listens, in this process."""
    ends: list[Callable[[bool], None]] = []

    def start(token: str | None = None, **fields: Any) -> GatewayService:
        service = GatewayService(
            op3,
            "sim",
            Gateway.model_validate(fields),
            run.telemetry,
            run.targets,
            run.heard,
            Admission("127.0.0.1", token),
            port=any_free(),
            stop_port=1,
        )
        ends.append(service.follow())
        wait_until(lambda: listens(service.port), "the gateway to listen")
        return service

    yield start
    for end in ends:
        end(True)


def listens(port: int) -> bool:
    with socket.socket() as probe:
        return probe.connect_ex(("127.0.0.1", port)) == 0
