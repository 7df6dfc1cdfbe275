"""What carries stops does not end unseen: it is told, and started again."""

from __future__ import annotations

import asyncio
import os
import threading
from collections.abc import Callable

import pytest

from flexmotion.configs.robot import Robot
from flexmotion.configs.stream import Gateway
from flexmotion.streamer.gateway import presses as presses_module
from flexmotion.streamer.gateway.admission import Admission
from flexmotion.streamer.gateway.health import Health
from flexmotion.streamer.gateway.lines import Lines
from flexmotion.streamer.gateway.ports import any_free
from flexmotion.streamer.gateway.presses import Presses
from flexmotion.streamer.gateway.service import GatewayService
from flexmotion.streamer.gateway.stops import StopService
from flexmotion.streamer.gateway.ways import Way
from flexmotion.streamer.run.planner_process import Heartbeat
from flexmotion.streamer.run.requests import Request, RequestChannel

from ...waiting import wait_until
from .conftest import Answering, Office, Run
from .test_server import http

FAILED = "failed (ModuleNotFoundError: no wire) and is started again"


class Told:
    """A way, and what the loop is told of it."""

    def __init__(self) -> None:
        channel = RequestChannel()
        self.way, self._reader = Way("stops over telegraph", channel), channel.reader()

    def read(self) -> list[tuple[Request, str]]:
        return self._reader.read()


def test_a_thread_that_fails_is_told_and_started_again() -> None:
    """An error outside its `try` ended the thread that carried the stops, and nobody was told."""
    told, works, begun = Told(), threading.Event(), []

    def work() -> None:
        begun.append(told.way.problem)
        if len(begun) == 1:
            raise ValueError("the wire broke")
        told.way.works()
        works.set()

    told.way.keep(work, threading.Event(), "telegraph")
    wait_until(works.is_set, "the second start")
    assert begun == [None, "failed (ValueError: the wire broke) and is started again"] and told.way.problem is None
    assert told.read() == [
        (Request.WARNING, "stops over telegraph: failed (ValueError: the wire broke) and is started again"),
        (Request.NOTE, "stops over telegraph: works again"),
    ]


def test_a_thread_that_has_been_ended_is_not_started_again() -> None:
    told, ended = Told(), threading.Event()

    def work() -> None:
        ended.set()
        raise OSError("closed")

    told.way.keep(work, ended, "telegraph").join()
    assert told.read() == []


def test_one_that_comes_and_goes_pushes_no_stop_out_of_the_channel(monkeypatch: pytest.MonkeyPatch) -> None:
    """The channel holds 32 requests."""
    told = Told()
    monkeypatch.setattr("flexmotion.streamer.gateway.ways.time.monotonic", lambda: 100.0)
    take = told.way.guarded(lambda item: 1 // item)
    for number in range(1000):
        take(number % 2)
    assert len(told.read()) == 1


def test_a_library_that_calls_is_kept_from_errors() -> None:
    told = Told()
    take = told.way.guarded(lambda item: 1 // item)
    take(0)
    assert told.way.problem is not None and "ZeroDivisionError" in told.way.problem
    take(1)
    assert told.way.problem is None


class Telegraph:
    """A `StopInput` whose library does not start at once."""

    name = "telegraph"

    def __init__(self) -> None:
        self.mended = self.ended = False
        self.presses: Presses | None = None

    def begin(self, presses: Presses, way: Way) -> Callable[[], None]:
        if not self.mended:
            raise ModuleNotFoundError("no wire")
        self.presses = presses
        way.works()
        return lambda: setattr(self, "ended", True)


def test_a_way_to_stop_that_cannot_be_started_is_told_and_tried_again(
    run: Run, op3: Robot, answering: Callable[..., Answering]
) -> None:
    """It was a line in the log of a process; the status and the page said nothing."""
    telegraph, settings = Telegraph(), Gateway()
    stops = StopService(settings, run.telemetry, None, inputs=(telegraph,))
    shared = (settings, run.telemetry, run.targets, run.heard)
    gateway = GatewayService(op3, "sim", *shared, Admission(), port=any_free(), stops=stops.health)
    loop = answering(gateway.requests, stops.requests)
    ends = [stops.follow(), gateway.follow()]
    try:
        wait_until(lambda: answers(gateway.port) == (503, FAILED), "the failure")
        telegraph.mended = True
        wait_until(lambda: answers(gateway.port) == (200, "works"), "the second start")
        # What is told and what is pressed come by two ways: on a busy machine the emergency stop came first.
        wait_until(lambda: Request.NOTE in loop.requested, "the note of the second start")
        assert telegraph.presses is not None
        telegraph.presses.press(Request.ESTOP, "telegraph")
        wait_until(lambda: Request.ESTOP in loop.requested, "the emergency stop")
        ways = http(gateway.port, "GET", "/status")[1]["ways"]
        assert ways == {"stops over telegraph": "works", "stop process": "works"}
        assert loop.requested[:2] == [Request.WARNING, Request.NOTE]
    finally:
        for end in ends:
            end(True)
    assert telegraph.ended


def answers(port: int) -> tuple[int, str] | None:
    try:
        status, content = http(port, "GET", "/health")
    except OSError:
        return None
    return status, content["ways"]["stops over telegraph"]


def test_a_stop_process_that_gives_no_sign_of_life_is_seen() -> None:
    alive = Heartbeat()
    health = Health((), alive)
    assert health.problems()["stop process"].startswith("no sign of life: ")
    alive.beat()
    assert health.problems() == {"stop process": "works"}
    alive._stamp[0] -= 60_000_000_000
    assert health.problems()["stop process"].startswith("no sign of life for 60 s")


def test_a_stop_is_sent_whatever_becomes_of_the_answers(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    """The bookkeeping of answers came before the request, and its errors ended the thread."""
    requests = RequestChannel()
    reader, presses = requests.reader(), Presses(run.telemetry, requests)

    def torn(_reader: object) -> None:
        raise UnicodeDecodeError("utf-8", b"\xff", 0, 1, "torn")

    told: list[object] = []
    with monkeypatch.context() as patched:
        patched.setattr(presses_module, "events", torn)
        presses.press(Request.STOP, "test", told.append)
        presses.press(Request.ESTOP, "test", told.append)
        assert [request for request, _ in reader.read()] == [Request.STOP, Request.ESTOP]
    wait_until(lambda: run.take(Request.STOP) or run.take(Request.ESTOP) or len(told) == 2, "the answers")


def test_standard_input_that_breaks_is_told(make_office: Callable[..., Office]) -> None:
    """A terminal that hung up ended the thread that read it."""
    told = Told()

    async def read() -> None:
        own, other = os.openpty()
        os.close(other)  # it is hung up: reading fails
        Lines(own, os.dup(1), make_office().desk, lambda: None, told.way)
        while told.way.problem is None:
            await asyncio.sleep(0.01)

    asyncio.run(asyncio.wait_for(read(), 60.0))
    assert told.way.problem is not None and told.way.problem.startswith("cannot be read any more: OSError")
