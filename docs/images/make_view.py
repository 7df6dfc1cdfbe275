"""Makes `view.png`: the page of `--view` with the robot in mid-step, rendered by a headless Chromium.

    python docs/images/make_view.py [--out docs/images/view.png] [--after 9.2]

The run is in lockstep, so that it waits for the picture. Needs playwright (`pip install -e .[dev]`) and a Chromium on
the path; no graphics card.
"""

from __future__ import annotations

import io
import shutil
import time
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from PIL import Image
from playwright.sync_api import sync_playwright

from flexmotion.configs.robot import load_robot
from flexmotion.configs.stream import load_stream
from flexmotion.drivers.registry import create
from flexmotion.streamer.commands.choice import choose_motion
from flexmotion.streamer.motion.sources import ClipSource
from flexmotion.streamer.run.session import Session
from flexmotion.streamer.viewer.service import Viewer

SIZE = {"width": 1400, "height": 720}
SHOWN = {"x": 260, "y": 0, "width": 1140, "height": 720}
"""Part of the page: the robot is in its middle, the panel at the right, the left is empty."""
FLAGS = ("--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--ignore-gpu-blocklist")
LIFTED = 0.8
"""A foot is in mid-step above this share of `SWING_M`."""
SWING_M = 0.02
"""Usual height of a swing [m]."""
_DRAWN_S, _SETTLED_S = 0.06, 2.5
"""Longer than the time between two frames of the page; time for the browser to load and to draw [s]."""


PICTURE = Path(__file__).with_name("view.png")


def main(
    out: Annotated[Path, typer.Option(help="Picture to write.")] = PICTURE,
    after: Annotated[float, typer.Option(help="Take the first step after this time of the motion [s].")] = 9.2,
    clip: Annotated[Path | None, typer.Option(help="Motion file; default: the shipped one.")] = None,
) -> None:
    """Run, wait for a step, take the picture."""
    robot, settings = load_robot("op3"), load_stream()
    source = ClipSource(choose_motion(clip=clip))
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=shutil.which("chromium"), args=FLAGS)
        page = browser.new_page(viewport=SIZE)
        session = Session(robot, create("sim", robot, seed=0), source, settings)
        viewer = Viewer(robot, session.telemetry)
        taken = False

        def look(source_s: float) -> None:
            nonlocal taken
            row = session.record.rows[-1]
            if taken or not source_s > after - 1.0:
                return
            if page.url != f"{viewer.url}/":
                page.goto(viewer.url)
                # viser warns of rendering without a graphics card, which is intended here.
                page.get_by_role("alert").get_by_role("button").click()
            time.sleep(_DRAWN_S)
            lifted = np.nanmax(row["foot_ref"][:, 2])
            if source_s > after and lifted > LIFTED * SWING_M and not row["contact_ref"].all():
                time.sleep(_SETTLED_S)
                picture = Image.open(io.BytesIO(page.screenshot(clip=SHOWN)))
                # Fewer shades than the eye can tell apart: most of the file's size.
                picture.convert("RGB").point(lambda value: min(4 * round(value / 4), 255)).save(out, optimize=True)
                taken = True

        session.services = (viewer,)
        session.progress = look
        session.run()
        browser.close()
    if not taken:
        raise SystemExit(f"no foot was lifted after {after:g} s")
    print(f"{out}: {out.stat().st_size / 1e3:.0f} kB")


if __name__ == "__main__":
    typer.run(main)
