"""`--view` in a real browser: the page of a run shows the robot, and it moves."""

from __future__ import annotations

import io
import json
import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import matplotlib.image
import numpy as np
import pytest
import yaml

import flexmotion.importers.default_clip
from flexmotion.streamer.viewer.service import free_port

from ..waiting import HANGING_S, wait_until

if TYPE_CHECKING:
    from playwright.sync_api import Page

BROWSERS = ("chromium", "chromium-browser", "google-chrome")
PROGRAM = Path(__file__).parents[1] / "virtual_program.py"
FLAGS = ("--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--ignore-gpu-blocklist")
"""WebGL without a graphics card."""


@pytest.fixture
def tab() -> Iterator[Page]:
    """An empty page of a headless Chromium, without a network."""
    browser = next(filter(None, map(shutil.which, BROWSERS)), None)
    if browser is None:
        pytest.skip(f"no browser on the path: {', '.join(BROWSERS)}")
    api = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
    with api.sync_playwright() as playwright:
        chromium = playwright.chromium.launch(executable_path=browser, args=FLAGS, timeout=1e3 * HANGING_S)
        try:
            yield chromium.new_page(viewport={"width": 640, "height": 480})
        finally:
            chromium.close()


def picture(tab: Page) -> np.ndarray:
    """The left half of the page, where the scene is, (height, width, 3) in [0, 1]."""
    shot = matplotlib.image.imread(io.BytesIO(tab.screenshot(timeout=1e3 * HANGING_S)), format="png")
    return shot[:, :320, :3]


def moved_pixels(first: np.ndarray, second: np.ndarray) -> int:
    return int((np.abs(first - second).max(axis=2) > 0.1).sum())


def test_the_page_shows_a_robot_that_moves(tab: Page, tmp_path: Path) -> None:
    port = free_port(18400)
    # Longer than any browser takes that draws with the processor, which it shares with the run.
    clip = Path(flexmotion.importers.default_clip.__file__).parents[1] / "data" / "default.npz"
    script = tmp_path / "again.yaml"
    script.write_text(yaml.safe_dump([{"at": 10.0 * k, "clip": str(clip)} for k in range(60)]))
    abroad: list[str] = []
    tab.on("request", lambda request: abroad.append(request.url) if f":{port}" not in request.url else None)
    command = (sys.executable, str(PROGRAM), "run", "-r", "op3", "-d", "sim", "--no-realtime", "--script", str(script))
    command += ("--view", "--view-port", str(port), "--json")
    environment = os.environ | {"FASTEST": "1"}  # the browser needs the processor more than the run
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=environment) as run:
        try:
            assert run.stderr is not None and run.stdout is not None
            assert f"127.0.0.1:{port}" in run.stderr.readline()
            open_when_served(tab, f"http://127.0.0.1:{port}")
            tab.get_by_text("STREAMING", exact=True).wait_for(timeout=1e3 * HANGING_S)
            first = picture(tab)
            moved = any(moved_pixels(first, picture(tab)) > 50 for _ in range(30))
            run.terminate()
            report = json.loads(run.stdout.read())
        finally:
            run.kill()
    assert not [url for url in abroad if not url.startswith(("data:", "blob:"))]
    colours = np.unique((first * 255).astype(int).reshape(-1, 3), axis=0)
    assert len(colours) > 200
    assert first.std() > 0.05
    assert moved
    assert report["clock"] == "real"


def open_when_served(tab: Page, url: str) -> None:
    """Open the page; its address is printed before the viewer's process has loaded its server."""
    from playwright.sync_api import Error

    def opened() -> bool:
        try:
            tab.goto(url, wait_until="commit", timeout=1e3 * HANGING_S)
        except Error:
            return False
        return True

    wait_until(opened, f"{url} to be served", every_s=0.1)
