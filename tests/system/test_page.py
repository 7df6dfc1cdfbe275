"""The page of a run in a real browser: a prompt raises the robot's hand, the stick makes it walk, the stops stop it."""

from __future__ import annotations

import json
import math
import os
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from http.client import HTTPConnection
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

import flexmotion.data
from flexmotion.bundles.shipped import shipped_bundle
from flexmotion.streamer.gateway.ports import any_free

from ..waiting import HANGING_S, wait_until

if TYPE_CHECKING:
    from playwright.sync_api import Page

BROWSERS = ("chromium", "chromium-browser", "google-chrome")
PROGRAM = Path(__file__).parents[1] / "virtual_program.py"
FLAGS = ("--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--ignore-gpu-blocklist")
"""WebGL without a graphics card."""
CLIP = Path(flexmotion.data.__path__[0]) / "default.npz"
PHONE = {"width": 390, "height": 780}
RISE_M, WALK_M = 0.05, 0.05
"""A hand is raised, and a robot has walked, by more than this [m]."""
HAND = "r_el_link"
"""Body of OP3 that bears its right hand."""


@pytest.fixture
def tab() -> Iterator[Page]:
    """An empty page of a headless Chromium, as wide as a phone: it draws with the processor."""
    browser = next(filter(None, map(shutil.which, BROWSERS)), None)
    if browser is None:
        pytest.skip(f"no browser on the path: {', '.join(BROWSERS)}")
    api = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
    with api.sync_playwright() as playwright:
        chromium = playwright.chromium.launch(executable_path=browser, args=FLAGS, timeout=1e3 * HANGING_S)
        try:
            page = chromium.new_page(viewport=PHONE)
            page.set_default_timeout(1e3 * HANGING_S)
            yield page
        finally:
            chromium.close()


class Shown:
    """A run and its page."""

    def __init__(self, tab: Page, port: int) -> None:
        self.tab, self.port = tab, port
        self.problems: list[str] = []
        self.abroad: list[str] = []
        tab.on("pageerror", lambda error: self.problems.append(str(error)))
        tab.on("request", self._requested)

    def _requested(self, request: Any) -> None:
        if not request.url.startswith((f"http://127.0.0.1:{self.port}/", "http://127.0.0.1:", "data:", "blob:")):
            self.abroad.append(request.url)

    @property
    def status(self) -> dict[str, Any]:
        connection = HTTPConnection("127.0.0.1", self.port, timeout=HANGING_S)
        connection.request("GET", "/status")
        content = dict(json.loads(connection.getresponse().read()))
        connection.close()
        return content

    def until(self, expression: str, what: str) -> None:
        """Wait for JavaScript to be true. Playwright's own way evaluates text, which the page's policy forbids."""
        wait_until(lambda: bool(self.tab.evaluate(f"() => Boolean({expression})")), what, every_s=0.2)

    def body(self, name: str) -> list[float]:
        return [float(value) for value in self.tab.evaluate(f"() => window.flexmotion.scene.bodyPosition('{name}')")]

    def open(self) -> None:
        from playwright.sync_api import Error

        def opened() -> bool:
            try:
                self.tab.goto(f"http://127.0.0.1:{self.port}/", wait_until="commit")
            except Error:
                return False
            return True

        wait_until(opened, "the page to be served", every_s=0.3)
        self.until("window.flexmotion && window.flexmotion.scene.time > 0", "the first picture")


@pytest.fixture
def shown(tab: Page) -> Iterator[Callable[[], Shown]]:
    """Function () -> a run of the shipped model on the simulated robot with the shipped clip, and its page."""
    if shipped_bundle() is None:
        pytest.skip("no shipped model")
    port, stop_port = any_free(), any_free()
    command = (
        sys.executable,
        str(PROGRAM),
        "run",
        "-r",
        "op3",
        "-d",
        "sim",
        "--no-realtime",
        "--web",
    )
    command += ("--web-port", str(port), "--stop-port", str(stop_port), "--clips", str(CLIP))
    environment = os.environ | {"FASTEST": "1"}  # the browser needs the processor more than the run
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, env=environment) as run:
        try:
            yield lambda: Shown(tab, port)
        finally:
            run.terminate()
            try:
                run.wait(HANGING_S)
            finally:
                run.kill()


def test_a_prompt_raises_the_hand_the_stick_walks_and_the_stops_stop(shown: Callable[[], Shown]) -> None:
    page = shown()
    page.open()
    tab = page.tab
    assert page.status["state"] == "OFF"  # torque goes on only when somebody says so
    tab.get_by_role("button", name="Arm", exact=True).click()
    wait_until(lambda: page.status["state"] == "HOLD", "the robot to stand")
    low = page.body(HAND)[2]
    tab.fill("#prompt", "raise your right hand")
    tab.press("#prompt", "Enter")
    wait_until(lambda: page.body(HAND)[2] > low + RISE_M, "the hand to rise", every_s=0.2)
    assert "raise your right hand" in tab.inner_text("#history")
    page.until("!document.querySelector('#history .mark').textContent.includes('sent')", "the answer")
    assert tab.inner_text("#history .mark") in ("accepted", "unsure")

    begin = page.status["place"]
    box = tab.locator("#stick").bounding_box()
    assert box is not None
    middle = (box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
    tab.mouse.move(*middle)
    tab.mouse.down()
    tab.mouse.move(middle[0], middle[1] - box["height"])
    wait_until(lambda: math.dist(begin, page.status["place"]) > WALK_M, "the robot to walk", every_s=0.2)
    # On a busy machine a page sends so seldom that a velocity expires between two of the stick.
    wait_until(lambda: page.status["following"]["asked"].get("velocity", [0.0])[0] > 0.0, "the stick to be followed")
    page.until("document.getElementById('following').textContent === 'by stick: ahead'", "the label of the stick")
    # Velocities that newer ones replace are none of the person's who holds the stick: it was told as "replaced".
    page.until("document.querySelector('#history .mark').textContent === 'accepted'", "the stick to be accepted")
    tab.mouse.up()
    wait_until(lambda: page.status["state"] == "HOLD", "the robot to stand after the stick is released", every_s=0.2)

    tab.get_by_role("button", name="STOP", exact=True).click()
    page.until("document.getElementById('state').textContent === 'stopped'", "the page to say that it is stopped")
    assert page.status["must_stop"]
    assert (
        tab.is_disabled("#prompt") and tab.get_attribute("#prompt", "placeholder") == "Stopped: release the stop first"
    )
    assert page.status["following"] is None
    tab.get_by_role("button", name="Release stop").click()
    wait_until(lambda: not page.status["must_stop"], "the stop to be released", every_s=0.2)
    tab.fill("#prompt", "juggle")
    tab.press("#prompt", "Enter")
    page.until("document.querySelector('#history .mark').textContent === 'refused'", "the words to be refused")
    # The help was folded behind a long list of names.
    page.until("document.querySelectorAll('#history li:first-child .chips button').length > 2", "motions to try")
    assert "is not understood" in tab.inner_text("#history li:first-child")

    tab.get_by_role("button", name="EMERGENCY STOP").click()
    page.until(
        "document.getElementById('alarm').textContent.includes('Emergency stop pressed')",
        "the page to say what happened",
    )
    wait_until(lambda: page.status["state"] == "FAULT", "the robot to have parked", every_s=0.2)
    tab.get_by_role("button", name="Clear fault").click()
    wait_until(lambda: page.status["state"] == "OFF", "the fault to be cleared", every_s=0.2)
    # It tipped over without torque: "Arm" was refused where it was pressed a second later.
    tab.get_by_role("button", name="Arm", exact=True).click()
    wait_until(lambda: page.status["state"] == "READY", "the robot to stand up again", every_s=0.2)
    assert not page.problems and not page.abroad
    assert tab.evaluate("() => document.documentElement.scrollWidth <= innerWidth")  # nothing beyond a phone's width


def test_a_click_on_the_floor_and_a_clip_move_the_robot(shown: Callable[[], Shown]) -> None:
    """The page had no way to send a waypoint or a clip."""
    page = shown()
    page.open()
    tab = page.tab
    tab.get_by_role("button", name="Arm", exact=True).click()
    wait_until(lambda: page.status["state"] == "HOLD", "the robot to stand")
    box = tab.locator("#scene").bounding_box()
    assert box is not None
    tab.mouse.click(box["x"] + 0.75 * box["width"], box["y"] + 0.55 * box["height"])
    chosen = tab.evaluate("() => window.flexmotion.floor.chosen")
    assert math.hypot(chosen["ahead"], chosen["left"]) > WALK_M
    assert page.status["following"] is None  # a stray tap moves nothing
    tab.get_by_role("button", name="Walk here").click()
    wait_until(lambda: page.status["following"] is not None, "the waypoint to be taken", every_s=0.2)
    asked = page.status["following"]["asked"]
    # The robot has not moved yet: its odometry begins where it stood up, looking ahead.
    assert asked["waypoint"][:2] == pytest.approx([chosen["ahead"], chosen["left"]], abs=0.02)
    wait_until(lambda: page.status["state"] == "STREAMING", "the robot to set out", every_s=0.2)
    tab.select_option("#clip", CLIP.name)
    tab.get_by_role("button", name="Play").click()
    wait_until(lambda: page.status["following"]["asked"] == {"clip": CLIP.name}, "the clip to be taken", every_s=0.2)
    assert f"{CLIP.name}" in tab.inner_text("#history")
    assert not page.problems and not page.abroad
