"""The stop process: what it takes, from whom, and how soon the driver has it."""

from __future__ import annotations

import json
import socket
from collections.abc import Callable, Iterator
from http.client import HTTPConnection
from typing import Any

import pytest

from flexmotion.configs.robot import Robot
from flexmotion.configs.stream import Gateway
from flexmotion.streamer.cli import execute
from flexmotion.streamer.gateway.admission import Admission
from flexmotion.streamer.gateway.client import Client
from flexmotion.streamer.gateway.ports import any_free
from flexmotion.streamer.gateway.service import GatewayService
from flexmotion.streamer.gateway.stops import StopService
from flexmotion.streamer.run.requests import Request

from ...waiting import HANGING_S, wait_until
from .conftest import Answering, Run, listens

TOKEN = "correct horse battery"
PAGE_PORT = 8790

Begin = Callable[..., StopService]


@pytest.fixture
def begin(run: Run) -> Iterator[Begin]:
    """Function (token) -> a stop service that listens, in this process."""
    ends: list[Callable[[bool], None]] = []

    def start(token: str | None = None) -> StopService:
        admission = Admission("127.0.0.1", token, page_port=PAGE_PORT)
        service = StopService(Gateway(), run.telemetry, admission, port=any_free())
        ends.append(service.follow())
        wait_until(lambda: listens(service.port), "the stop service to listen")
        return service

    yield start
    for end in ends:
        end(True)


def press(port: int, path: str, method: str = "POST", **headers: str) -> tuple[int, Any, dict[str, str]]:
    connection = HTTPConnection("127.0.0.1", port, timeout=HANGING_S)
    connection.request(method, path, headers=headers)
    response = connection.getresponse()
    content = json.loads(response.read())
    connection.close()
    return response.status, content, dict(response.getheaders())


def test_a_stop_needs_no_token_and_an_emergency_stop_does(begin: Begin, answering: Callable[..., Answering]) -> None:
    service = begin(TOKEN)
    loop = answering(service.requests)
    assert press(service.port, "/stop")[0] == 200
    assert press(service.port, "/estop")[0] == 401
    assert press(service.port, "/estop", Authorization="Bearer wrong wrong wrong")[0] == 401
    assert loop.requested == [Request.STOP]
    status, told, _ = press(service.port, "/estop", Authorization=f"Bearer {TOKEN}")
    assert (status, told["state"], told["asked"]) == (200, "accepted", "estop") and told["tick"] >= 0
    assert loop.requested == [Request.STOP, Request.ESTOP]


def test_nothing_but_stops_is_taken(begin: Begin, answering: Callable[..., Answering]) -> None:
    service = begin()
    loop = answering(service.requests)
    found = [press(service.port, path)[0] for path in ("/", "/clear", "/kill", "/text", "/stop/")]
    assert found == [404] * 5
    assert press(service.port, "/estop", "GET")[0] == 405
    assert press(service.port, "/stop", "DELETE")[0] == 405
    assert loop.requested == []


def test_the_page_of_the_run_may_press_and_no_other_page(begin: Begin, answering: Callable[..., Answering]) -> None:
    service = begin()
    loop = answering(service.requests)
    own = f"http://127.0.0.1:{PAGE_PORT}"
    status, _, headers = press(service.port, "/estop", Origin=own)
    assert status == 200 and headers["access-control-allow-origin"] == own
    status, _, headers = press(service.port, "/estop", "OPTIONS", Origin=own)
    assert status == 200 and headers["access-control-allow-headers"] == "authorization"
    assert press(service.port, "/estop", Origin="https://evil.example")[0] == 403
    assert press(service.port, "/stop", Host="evil.example")[0] == 403
    assert loop.requested == [Request.ESTOP]


def test_a_loop_that_does_not_run_is_told(begin: Begin) -> None:
    service = begin()
    status, told, _ = press(service.port, "/estop")
    assert (status, told["state"]) == (503, "refused") and "the loop did not take it" in told["reason"]


def test_connections_that_send_nothing_or_nonsense_keep_no_stop_out(
    begin: Begin, answering: Callable[..., Answering]
) -> None:
    service = begin()
    loop = answering(service.requests)
    silent = [socket.create_connection(("127.0.0.1", service.port)) for _ in range(150)]
    for number, one in enumerate(silent):
        one.sendall([b"", b"\x00\xff\r\n\r\n", b"POST /estop HTTP/1.1\r\n", b"x" * 20_000][number % 4])
    assert press(service.port, "/stop")[0] == 200
    assert loop.requested == [Request.STOP]
    for one in silent:
        one.close()


def test_the_command_line_presses(
    begin: Begin, answering: Callable[..., Answering], capsys: pytest.CaptureFixture[str]
) -> None:
    service = begin()
    loop = answering(service.requests)
    port = ["--stop-port", str(service.port)]
    assert execute(["stop", *port]) == 0 and execute(["estop", "--json", *port]) == 0
    assert loop.requested == [Request.STOP, Request.ESTOP]
    told = capsys.readouterr().out
    assert told.startswith("accepted before tick") and "refuses targets until: flexmotion clear" in told
    assert execute(["estop", "--stop-port", str(any_free())]) == 3


def test_a_stop_finds_its_port_from_that_for_targets(
    begin: Begin, answering: Callable[..., Answering], run: Run, op3: Robot, capsys: pytest.CaptureFixture[str]
) -> None:
    """`flexmotion stop --port N` was an unknown option, and `Client(port=N).stop()` went to another run."""
    service = begin(TOKEN)
    loop = answering(service.requests)
    admission = Admission("127.0.0.1", TOKEN)
    ports: dict[str, Any] = {"port": any_free(), "stop_port": service.port}
    gateway = GatewayService(op3, "sim", Gateway(), run.telemetry, run.targets, run.heard, admission, **ports)
    end = gateway.follow()
    wait_until(lambda: listens(gateway.port), "the gateway to listen")
    try:
        connected = Client(port=gateway.port, token=TOKEN, source="phone")
        connected.take()
        assert execute(["stop", "--port", str(gateway.port)]) == 0, "a STOP needs no token"
    finally:
        end(True)
    assert connected.stop().state == "accepted", "it has known the port since it connected"
    assert execute(["stop", "--port", str(gateway.port)]) == 3
    assert "its port for stops is not known, give it: --stop-port" in capsys.readouterr().err
    assert execute(["stop", "--port", str(gateway.port), "--stop-port", str(service.port)]) == 0, "needs no gateway"
    assert Client(port=service.port, token=TOKEN).stop().state == "accepted", "it is the port for stops already"
    assert loop.requested == [Request.STOP] * 4
