"""The page of a run, as a browser gets it: files, policy, token, pictures."""

from __future__ import annotations

import json
import re
import socket
from collections.abc import Callable, Iterator
from http.client import HTTPConnection
from typing import Any

import numpy as np
import pytest
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect

from flexmotion.configs.robot import Robot
from flexmotion.configs.stream import Gateway, load_stream
from flexmotion.drivers.registry import create
from flexmotion.streamer.commands.choice import choose_motion
from flexmotion.streamer.control.telemetry import Telemetry
from flexmotion.streamer.control.tick_row import TickRow, blank
from flexmotion.streamer.gateway.admission import Admission
from flexmotion.streamer.gateway.listening import Listening, listen
from flexmotion.streamer.gateway.ports import any_free
from flexmotion.streamer.gateway.service import GatewayService
from flexmotion.streamer.motion.heard import Heard
from flexmotion.streamer.motion.sources import ClipSource
from flexmotion.streamer.page.feed import Feed
from flexmotion.streamer.run.session import Session

from ...waiting import HANGING_S, wait_until
from .conftest import Run

TOKEN = "0123456789abcdef"


@pytest.fixture
def telemetry(op3: Robot) -> Telemetry:
    told = Telemetry(op3.n, op3.rate_hz)
    row = blank(TickRow.dtype(joints=op3.n))
    row["q"] = op3.stand_pose
    for tick in range(50):
        row["tick"] = tick
        told.ticks.publish(row)
    return told


@pytest.fixture
def begin(run: Run, op3: Robot, telemetry: Telemetry) -> Iterator[Callable[..., GatewayService]]:
    """Function (token, takes_targets) -> a gateway with a page."""
    ends: list[Callable[[bool], None]] = []

    def start(token: str | None = None, *, takes_targets: bool = True) -> GatewayService:
        service = GatewayService(
            op3,
            "sim",
            Gateway(),
            telemetry,
            run.targets,
            run.heard,
            Admission("127.0.0.1", token),
            port=any_free(),
            stop_port=8791,
            takes_targets=takes_targets,
            feed=lambda source_of: Feed(op3, telemetry, None, run.heard, (), source_of),
        )
        ends.append(service.follow())
        wait_until(lambda: get(service, "/page/page.css")[0] == 200, "the gateway to listen")
        return service

    yield start
    for end in ends:
        end(True)


def get(service: GatewayService, path: str, **headers: str) -> tuple[int, dict[str, str], str]:
    connection = HTTPConnection("127.0.0.1", service.port, timeout=HANGING_S)
    try:
        connection.request("GET", path, headers=headers)
        response = connection.getresponse()
        known = {name.lower(): value for name, value in response.getheaders()}
        return response.status, known, response.read().decode()
    except ConnectionError:
        return 0, {}, ""
    finally:
        connection.close()


def test_every_file_that_the_page_names_is_served(begin: Callable[..., GatewayService]) -> None:
    service = begin()
    status, headers, page = get(service, "/")
    assert status == 200 and headers["content-type"].startswith("text/html")
    queue, seen = re.findall(r'(?:src|href|"three":)[= ]*"(/page/[^"]+)"', page), set()
    assert len(queue) >= 4
    while queue:
        path = queue.pop()
        if path in seen:
            continue
        seen.add(path)
        status, _, content = get(service, path)
        assert status == 200, path
        if path.endswith(".js"):
            folder = path.rsplit("/", 1)[0]
            named = re.findall(r'(?:from|import) ?"([^"]+)"', content)
            queue += [one if one.startswith("/") else f"{folder}/{one[2:]}" for one in named if one != "three"]
    assert {"/page/scene.js", "/page/three/three.core.min.js", "/page/three/OrbitControls.js"} <= seen


def test_the_page_may_load_nothing_from_elsewhere(begin: Callable[..., GatewayService]) -> None:
    service = begin()
    _, headers, page = get(service, "/")
    policy = dict(part.strip().split(" ", 1) for part in headers["content-security-policy"].split(";"))
    assert policy["default-src"] == "'none'" and policy["frame-ancestors"] == "'none'"
    assert policy["connect-src"] == f"'self' ws://127.0.0.1:{service.port} http://127.0.0.1:8791"
    assert "unsafe" not in headers["content-security-policy"]
    assert not re.findall(r"https?://", page)
    assert get(service, "/", host="evil.example")[0] == 403


def test_the_files_need_no_token_and_the_run_does(begin: Callable[..., GatewayService]) -> None:
    """A browser loads the page before the page can ask for the token."""
    service = begin(TOKEN)
    assert get(service, "/")[0] == 200 and get(service, "/page/page.js")[0] == 200
    for path in ("/robot", "/status", "/docs", "/page/../status", "/page/%2e%2e/status"):
        assert get(service, path)[0] in (401, 404), path
    assert get(service, "/robot", authorization=f"Bearer {TOKEN}")[0] == 200
    with pytest.raises(InvalidStatus), connect(f"ws://127.0.0.1:{service.port}/targets?page"):
        pass
    with connect(f"ws://127.0.0.1:{service.port}/targets?page&token={TOKEN}") as page:
        assert json.loads(page.recv(HANGING_S))["type"] == "curves"


def test_no_file_outside_the_page_is_served(begin: Callable[..., GatewayService]) -> None:
    service = begin()
    for path in ("/page/../feed.py", "/page/..%2ffeed.py", "/page/%2e%2e/feed.py", "/page//etc/passwd"):
        assert get(service, path)[0] == 404, path


def test_a_page_gets_pictures_and_what_was_asked(
    begin: Callable[..., GatewayService], run: Run, telemetry: Telemetry, op3: Robot
) -> None:
    service = begin()
    row = blank(TickRow.dtype(joints=op3.n))
    row["q"], row["tick"] = op3.stand_pose, 50
    with connect(f"ws://127.0.0.1:{service.port}/targets?page") as page:
        assert json.loads(page.recv(HANGING_S))["type"] == "curves"
        telemetry.ticks.publish(row)
        run.heard.publish(Heard(id=3, asked="wave", state="accepted", heard_as="wave-right"))
        found: list[Any] = []
        while not (any(isinstance(one, bytes) for one in found) and any("wave-right" in str(one) for one in found)):
            found.append(page.recv(HANGING_S))
    with connect(f"ws://127.0.0.1:{service.port}/targets?status=20") as other:
        told = [other.recv(HANGING_S) for _ in range(5)]
    assert all(json.loads(one)["type"] in ("status", "lease") for one in told)  # no page, no pictures


def test_a_run_that_only_shows_itself_takes_no_targets(begin: Callable[..., GatewayService], run: Run) -> None:
    service = begin(takes_targets=False)
    with connect(f"ws://127.0.0.1:{service.port}/targets") as page:
        page.send('{"type":"velocity","velocity":[0.2,0,0]}')
        answer = json.loads(page.recv(HANGING_S))
        assert answer["state"] == "refused" and "--web" in answer["reason"]
        page.send('{"type":"take"}')
        assert json.loads(page.recv(HANGING_S))["state"] == "refused"
    assert not run.arrived()


def test_a_run_is_the_same_with_and_without_its_page(op3: Robot, capfd: pytest.CaptureFixture[str]) -> None:
    def session() -> Session:
        return Session(op3, create("sim", op3, seed=0), ClipSource(choose_motion()), load_stream(), 0.5, realtime=False)

    plain, shown = session(), session()
    listening = Listening(port=any_free(), stop_port=any_free(), takes_targets=False)
    listen(shown, listening)
    seen: list[bytes | str] = []

    def look(_source_s: float) -> None:
        if not seen:
            wait_until(lambda: _is_served(listening.port or 0), "the page to be served")
            with connect(f"ws://127.0.0.1:{listening.port}/targets?page") as page:
                seen.append(page.recv(HANGING_S))

    shown.progress = look
    one, other = plain.run(), shown.run()
    for column in ("tick", "state", "q", "q_cmd", "dcm", "true_base"):
        np.testing.assert_array_equal(getattr(one, column), getattr(other, column))
    assert seen and capfd.readouterr().out == ""


def _is_served(port: int) -> bool:
    with socket.socket() as probe:
        return probe.connect_ex(("127.0.0.1", port)) == 0
