"""Makes `dynamics.png`: the page of plots of `flexmotion data dynamics` for the steps of the shipped clip.

    python docs/images/make_dynamics.py [--out docs/images/dynamics.png]

Needs the extra `biomech`.
"""

from __future__ import annotations

import io
from pathlib import Path
from typing import Annotated

import typer
from PIL import Image

from flexmotion.biomechanics.analysis import analyse
from flexmotion.importers.default_clip import default_clip
from flexmotion.streamer.plots.clip_dynamics import draw_dynamics
from flexmotion.streamer.plots.style import styled

FIRST, LAST = 7.0, 11.5
"""Part of the clip with its steps [s]."""

PICTURE = Path(__file__).with_name("dynamics.png")


def main(out: Annotated[Path, typer.Option(help="Picture to write.")] = PICTURE) -> None:
    """Analyse the clip, draw the page."""
    clip = default_clip()
    found = analyse(clip[int(FIRST * clip.fps) : int(LAST * clip.fps)])
    drawn = io.BytesIO()
    with styled():
        draw_dynamics(found).savefig(drawn, format="png", dpi=90)
    # As many colours as the eye needs, for a small file.
    Image.open(drawn).convert("RGB").quantize(256).save(out, optimize=True)
    print(f"{out}: {out.stat().st_size / 1e3:.0f} kB")


if __name__ == "__main__":
    typer.run(main)
