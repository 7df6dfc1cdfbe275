"""`StandIn`: a run that the page in a browser takes for one: its files, its robot, and messages that a test chooses.

The browser is a real one. No robot and no gateway are needed, so that every state of a page can be shown.
"""

from __future__ import annotations

import json
import shutil
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from importlib.resources import files
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from flexmotion.configs.robot import Robot
from flexmotion.streamer.control.tick_row import TickRow, blank
from flexmotion.streamer.page.body import page_robot
from flexmotion.streamer.page.curves import NAMES
from flexmotion.streamer.page.pictures import Pictures
from flexmotion.streamer.page.pose import Pose

from ...waiting import HANGING_S, wait_until

if TYPE_CHECKING:
    from playwright.sync_api import Page, Route, WebSocketRoute

BROWSERS = ("chromium", "chromium-browser", "google-chrome")
FLAGS = ("--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--ignore-gpu-blocklist")
"""WebGL without a graphics card."""
WITHOUT_WEBGL = ("--disable-3d-apis",)
ADDRESS = "http://127.0.0.1:8790/"
KINDS = ("stand", "walk", "bow", "wave-right-hand")
TYPES = {"html": "text/html", "js": "text/javascript", "css": "text/css", "svg": "image/svg+xml"}


@contextmanager
def browser_page(flags: Sequence[str] = FLAGS, **options: Any) -> Iterator[Page]:
    """An empty page of a headless Chromium, which draws with the processor unless `flags` say otherwise."""
    browser = next(filter(None, map(shutil.which, BROWSERS)), None)
    if browser is None:
        pytest.skip(f"no browser on the path: {', '.join(BROWSERS)}")
    api = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
    with api.sync_playwright() as playwright:
        chromium = playwright.chromium.launch(executable_path=browser, args=flags, timeout=1e3 * HANGING_S)
        try:
            page = chromium.new_page(**options)
            page.set_default_timeout(1e3 * HANGING_S)
            yield page
        finally:
            chromium.close()


class StandIn:
    """A run, as far as a page can tell.

    Attributes:
        page: in the browser.
        asked: messages that the page has sent.
        pressed: stops that reached the stop process.
        stops_answer: whether the stop process answers.
        problems: errors of the page.
    """

    def __init__(self, page: Page, robot: Robot) -> None:
        self.page, self.robot = page, robot
        self.asked: list[dict[str, Any]] = []
        self.pressed: list[str] = []
        self.problems: list[str] = []
        self.stops_answer = True
        self.clips: tuple[str, ...] = ()
        self._socket: WebSocketRoute | None = None
        self._tick = 0

    def open(self) -> None:
        """Open the page, and wait for its first picture."""
        self.page.on("pageerror", lambda error: self.problems.append(str(error)))
        self.page.route("**/*", self._serve)
        self.page.route_web_socket("**/targets**", self._connect)
        self.page.goto(ADDRESS, wait_until="commit")
        self.until(lambda: self._socket is not None, "the page to connect")
        self.picture()
        self.until(lambda: self.page.evaluate("() => window.flexmotion.scene.time > 0"), "the first picture")

    def until(self, happens: Any, what: str) -> None:
        """Wait for something; the page goes on meanwhile."""

        def looked() -> bool:
            self.page.wait_for_timeout(20)
            return bool(happens())

        wait_until(looked, what)

    def _serve(self, route: Route) -> None:
        url = route.request.url
        path = url.removeprefix(ADDRESS)
        if path == "robot":
            route.fulfill(json=page_robot(self.robot, "sim", None, self.clips, KINDS))
        elif not path or path.startswith("page/"):
            name = path.removeprefix("page/") or "index.html"
            content = (files("flexmotion.streamer.page") / "static" / name).read_bytes()
            route.fulfill(body=content, content_type=TYPES[name.rsplit(".", 1)[1]])
        elif self.stops_answer:
            self.pressed.append(url.rsplit("/", 1)[1])
            route.fulfill(json={"state": "accepted"}, headers={"access-control-allow-origin": "*"})
        else:
            route.abort()

    def _connect(self, socket: WebSocketRoute) -> None:
        self._socket = socket
        socket.on_message(lambda text: self.asked.append(json.loads(text)))

    def send(self, content: dict[str, Any] | bytes) -> None:
        """Send a message or a picture to the page."""
        assert self._socket is not None
        self._socket.send(content if isinstance(content, bytes) else json.dumps(content))

    def answer(self, **known: Any) -> None:
        """Answer the newest message of the page."""
        message = self.asked[-1]
        self.send({"type": "answer", "id": message["id"], "asked": message["type"], **known})

    def status(self, state: str, **known: Any) -> None:
        """The state of the ladder, and what else a status says."""
        usual = {"loop": "ticks", "must_stop": False, "operator": None, "counts": {}, "stop_port": 8791, "target": 0}
        self.send({"type": "status", "robot": "op3", "driver": "sim", "state": state, **usual, **known})

    def event(self, kind: str, message: str, advice: str | None = None) -> None:
        """Something that has happened."""
        told = {} if advice is None else {"advice": advice}
        self.send({"type": "event", "time_s": 41.2, "kind": kind, "message": message, **told})

    def heard(self, number: int, asked: str, state: str, **known: Any) -> None:
        """The planner's answer to a target of this page."""
        source = self.page.evaluate("() => window.flexmotion.link.source")
        self.send({"type": "heard", "id": number, "asked": asked, "state": state, "source": source, **known})

    def figures(self) -> None:
        """Figures and curves as of a run that walks."""
        time_s = np.arange(0.0, 30.0, 0.1)
        samples = [[float(t), *(abs(float(np.sin(t + n))) for n in range(len(NAMES) - 1))] for t in time_s]
        self.send({"type": "curves", "names": list(NAMES), "samples": samples, "begin": True})
        hardest = [[name, 0.9 - 0.1 * number] for number, name in enumerate(self.robot.joint_names[:6])]
        joints = self.robot.n
        self.send(
            {"type": "health", "hardest": hardest, "temperatures": [41.0] * joints, "voltages": [12.0] * joints}
            | {name: [0.1, 0.2] for name in ("wake_ms", "work_ms")}
            | dict.fromkeys(("sample_ms", "retarget_ms", "target_to_command_ms"), 12.0)
            | dict.fromkeys(("plan", "late_plans", "underruns", "missed_deadlines", "violations"), 0)
            | dict.fromkeys(("steps_planned", "steps_inserted"), 0)
            | {"hung": False}
        )

    def picture(
        self, odometry: tuple[float, float, float] = (0.0, 0.0, 0.0), moved: tuple[float, float] = (0.0, 0.0)
    ) -> None:
        """The robot a second later, standing where it began, or `moved` from there [m]."""
        row = blank(TickRow.dtype(joints=self.robot.n))
        self._tick += 125
        row["tick"], row["q"], row["odometry"] = self._tick, self.robot.stand_pose, odometry
        row["true_base"] = Pose(self.robot).base
        row["true_base"][:2] += moved
        self.send(Pictures(self.robot, None).of(row))

    def lose(self) -> None:
        """The connection is lost, and cannot be made again."""
        self.page.evaluate("() => { window.flexmotion.link.connect = () => {}; }")
        assert self._socket is not None
        self._socket.close()
