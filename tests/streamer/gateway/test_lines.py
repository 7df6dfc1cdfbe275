"""Messages on standard input, answers on standard output: pipes to a gateway without a network."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Iterator
from typing import IO, Any

import pytest

from flexmotion.configs.robot import Robot
from flexmotion.configs.stream import Gateway
from flexmotion.streamer.gateway.service import GatewayService
from flexmotion.streamer.motion.intents import Text
from flexmotion.streamer.run.requests import Request

from ...waiting import wait_until
from .conftest import Answering, Run


class Pipes:
    """A gateway that reads lines; the test writes them and reads the answers."""

    def __init__(self, run: Run, op3: Robot) -> None:
        source, write = os.pipe()
        read, sink = os.pipe()
        self.write: IO[bytes] = os.fdopen(write, "wb", buffering=0)
        self.read: IO[bytes] = os.fdopen(read, "rb")
        settings = Gateway(most_bytes=512)
        self.service = GatewayService(
            op3, "sim", settings, run.telemetry, run.targets, run.heard, None, lines=(source, sink)
        )
        self.end = self.service.follow()

    def ask(self, line: bytes) -> Any:
        self.write.write(line)
        return json.loads(self.read.readline())


@pytest.fixture
def pipes(run: Run, op3: Robot) -> Iterator[Pipes]:
    made = Pipes(run, op3)
    yield made
    made.write.close()
    made.end(True)


def test_every_line_is_answered(pipes: Pipes, answering: Callable[..., Answering]) -> None:
    planner = answering(pipes.service.requests)
    assert pipes.service.url is None
    answer = pipes.ask(b'{"type":"text","text":"wave","id":"1"}\n')
    assert (answer["id"], answer["state"], answer["heard_as"]) == ("1", "accepted", "wave")
    assert pipes.ask(b'\n  \r\n{"type":"stop"}\r\n')["state"] == "accepted"
    assert pipes.ask(b"walk, please\n")["state"] == "refused"
    assert pipes.ask(b"\xff\xfe\x00\n")["state"] == "refused"
    assert planner.requested == [Request.STOP] and [one.intent for one in planner.seen] == [Text("wave")]


def test_a_line_that_is_too_long_is_refused_once_and_the_next_one_read(
    pipes: Pipes, answering: Callable[..., Answering]
) -> None:
    """Its rest was taken for further messages."""
    answering(pipes.service.requests)
    assert "expected at most 512" in pipes.ask(b'{"type":"stop"}' * 1000 + b"\n")["reason"]
    assert pipes.ask(b'{"type":"text","text":"wave"}\n')["state"] == "accepted"


def test_a_reader_that_went_away_does_not_end_the_targets(pipes: Pipes, answering: Callable[..., Answering]) -> None:
    planner = answering(pipes.service.requests)
    pipes.read.close()
    for number in range(1, 4):
        pipes.write.write(b'{"type":"text","text":"wave"}\n')
        wait_until(lambda number=number: len(planner.seen) == number, "the target")
    pipes.end(False)  # raises what ended the gateway
