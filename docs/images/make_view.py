"""Makes a picture: the page of a run with the robot in mid-step, rendered by a headless Chromium.

    python docs/images/make_view.py [--out docs/images/view.png] [--after 9.2] [--width 1280] [--dark]

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
from playwright.sync_api import Error, Page, sync_playwright

from flexmotion.configs.robot import load_robot
from flexmotion.configs.stream import load_stream
from flexmotion.drivers.registry import create
from flexmotion.streamer.commands.choice import choose_motion
from flexmotion.streamer.gateway.listening import Listening, listen
from flexmotion.streamer.gateway.ports import any_free
from flexmotion.streamer.motion.sources import ClipSource
from flexmotion.streamer.run.session import Session

FLAGS = ("--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--ignore-gpu-blocklist")
LIFTED = 0.8
"""A foot is in mid-step above this share of `SWING_M`."""
SWING_M = 0.015
"""Usual height of a swing [m]."""
_SETTLED_S, _SERVED_S = 2.5, 60.0
"""Time for the browser to draw, and longest time until the page is served [s]."""
_EXAMPLES = """() => {
  const take = window.flexmotion.link.handlers.message, end = window.flexmotion.scene.time;
  take({ type: "status", state: "STREAMING", loop: "ticks", must_stop: false, operator: null, counts: {}, target: 3 });
  const heard = { type: "heard", source: "page", certainty: 1, dropped: [], notes: [] };
  const [wave, why] = ["wave with the right hand", "not understood by this model"];
  take({ ...heard, id: 1, asked: wave, heard_as: "wave-right-hand", state: "accepted", at_s: end - 11 });
  take({ ...heard, id: 2, asked: "juggle five balls", state: "refused", reason: why, at_s: end - 6 });
  take({ ...heard, id: 3, asked: "walk forward", heard_as: "walk", state: "slowed", slowed: "0.9 m/s", at_s: end - 5 });
  window.flexmotion.asked.draw(end);
  window.flexmotion.link.handlers.message = () => {}; // the run waits for the picture: it would be told as silent
}"""
"""A clip is played, so that nobody is answered: examples of answers are shown."""
_OPENED_S = 3.0
"""The page is opened so long before, in time of the motion [s]."""

PICTURE = Path(__file__).with_name("view.png")


def main(
    out: Annotated[Path, typer.Option(help="Picture to write.")] = PICTURE,
    after: Annotated[float, typer.Option(help="Take the first step after this time of the motion [s].")] = 9.2,
    clip: Annotated[Path | None, typer.Option(help="Motion file; default: the shipped one.")] = None,
    width: Annotated[int, typer.Option(help="Of the page [pixels]; below 900 as on a phone.")] = 1280,
    height: Annotated[int, typer.Option(help="Of the page [pixels].")] = 800,
    dark: Annotated[bool, typer.Option(help="Dark colours.")] = False,
) -> None:
    """Run, wait for a step, take the picture."""
    robot, settings = load_robot("op3"), load_stream()
    source = ClipSource(choose_motion(clip=clip))
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=shutil.which("chromium"), args=FLAGS)
        page = browser.new_page(viewport={"width": width, "height": height}, color_scheme="dark" if dark else "light")
        session = Session(robot, create("sim", robot, seed=0), source, settings)
        port = any_free()
        listen(session, Listening(port=port, stop_port=any_free(), takes_targets=False))
        taken = shown = False

        def look(source_s: float) -> None:
            nonlocal taken, shown
            row = session.record.rows[-1]
            if taken or not source_s > after - _OPENED_S:
                return
            if page.url == "about:blank":
                _open(page, port)
            # The run goes on meanwhile: a page is sent pictures of new rows alone.
            shown = shown or page.evaluate("() => Boolean(window.flexmotion && window.flexmotion.scene.time > 0)")
            time.sleep(0.06)  # a picture a row, so that the path is drawn
            if not shown:
                return
            lifted = np.nanmax(row["foot_ref"][:, 2])
            if source_s > after and lifted > LIFTED * SWING_M and not row["contact_ref"].all():
                time.sleep(_SETTLED_S)
                page.evaluate(_EXAMPLES)
                picture = Image.open(io.BytesIO(page.screenshot()))
                # Fewer shades than the eye can tell apart: most of the file's size.
                picture.convert("RGB").point(lambda value: min(4 * round(value / 4), 255)).save(out, optimize=True)
                taken = True

        session.progress = look
        session.run()
        browser.close()
    if not taken:
        raise SystemExit(f"no foot was lifted after {after:g} s" if shown else "the page has shown no picture")
    print(f"{out}: {out.stat().st_size / 1e3:.0f} kB")


def _open(page: Page, port: int) -> None:
    end = time.monotonic() + _SERVED_S
    while True:
        try:
            page.goto(f"http://127.0.0.1:{port}/", wait_until="commit")
            break
        except Error:
            if time.monotonic() > end:
                raise
            time.sleep(0.2)


if __name__ == "__main__":
    typer.run(main)
