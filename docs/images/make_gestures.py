"""Makes `gestures.png`: a strip of figures of every made gesture.

    flexmotion data gestures RECORDINGS -o GESTURES
    python docs/images/make_gestures.py GESTURES [--out docs/images/gestures.png]

The shipped picture is of recordings of CMU, mocap.cs.cmu.edu (NSF EIA-0196217).
"""

from __future__ import annotations

import csv
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection

from flexmotion.configs.errors import ConfigError
from flexmotion.dataset.gestures.make import INDEX
from flexmotion.gestures.recipes import recipes
from flexmotion.human.kinematics import HumanKinematics, forward
from flexmotion.human.motion import Motion
from flexmotion.human.motion_file import load_motion
from flexmotion.streamer.plots.filmstrip import limbs
from flexmotion.streamer.plots.palette import HUMAN
from flexmotion.streamer.plots.solid import Camera
from flexmotion.streamer.plots.style import new_figure, save, styled

PICTURE = Path(__file__).with_name("gestures.png")
FIGURES, COLUMNS = 7, 2
SPACING = 0.62
"""Distance between neighbouring figures, in heights of the human."""
NOSE, EYES = 0.16, 0.1
"""Length of the line ahead from the head, and its distance below the vertex [m]."""
FROM_THE_FRONT, FROM_THE_SIDE = -25.0, -75.0
"""Azimuth of the camera: gestures to the side, and those that go ahead, up or down [degrees]."""


def example(folder: Path, kind: str) -> tuple[Motion, float, float]:
    """One standing motion of a kind with start and end of its gesture [s]; of CMU where there is one."""
    with (folder / INDEX).open(encoding="utf-8", newline="") as file:
        rows = [row for row in csv.DictReader(file) if row["content"] == kind and row["around"] == "stand"]
    found = sorted((path.parent.name != "cmu", path, row) for row in rows for path in folder.rglob(row["file"]))
    if not found:
        raise ConfigError(f"{folder / INDEX}: no motion of kind {kind!r}")
    _, path, row = found[0]
    return load_motion(path), float(row["start_s"]), float(row["end_s"])


def face(pose: HumanKinematics) -> np.ndarray:
    """Line from the eyes ahead, (2, 3) [m]."""
    eyes = pose.vertex[0] - EYES * pose.head_rotation[0, :, 2]
    return np.stack([eyes, eyes + NOSE * pose.head_rotation[0, :, 0]])


def strip(axes: Axes, title: str, motion: Motion, start: float, end: float, azimuth: float) -> None:
    """Figures of one gesture from its start to its end."""
    camera, height = Camera.at(azimuth, 12.0), motion.body.height
    for place, frame in enumerate(np.linspace(start * motion.fps, end * motion.fps, FIGURES).round().astype(int)):
        pose = forward(motion[min(frame, len(motion) - 1) :][:1])
        centre, offset = pose.pelvis_position[0] * [1.0, 1.0, 0.0], np.array([place * SPACING * height, 0.0])
        for points, colour in [*limbs(pose), (face(pose), HUMAN)]:
            line = camera.project(points - centre)[:, :2] + offset
            axes.add_collection(LineCollection([line], colors=colour, linewidths=1.7, capstyle="round"))
    axes.set(xlim=(-0.5 * height, ((FIGURES - 1) * SPACING + 0.5) * height), ylim=(-0.12 * height, 1.25 * height))
    axes.set_title(title)
    axes.set_aspect("equal")
    axes.set_axis_off()


def main(
    folder: Annotated[Path, typer.Argument(metavar="GESTURES", help="Folder of `data gestures`.")],
    out: Annotated[Path, typer.Option(help="Picture to write.")] = PICTURE,
) -> None:
    """Draw a strip of every gesture."""
    kinds = [gesture.kind for gesture in recipes()]
    rows = -(-len(kinds) // COLUMNS)
    with styled():
        figure = new_figure(13, 1.75 * rows + 0.6, "Gestures over recorded standing", "left is blue, right orange")
        panels = figure.subplots(rows, COLUMNS).ravel()
        for axes, kind in zip(panels, kinds, strict=False):
            ahead = any(
                word in kind for word in ("forward", "hold", "shake-hands", "squat", "crouch", "nod", "up", "down")
            )
            strip(axes, kind, *example(folder, kind), FROM_THE_SIDE if ahead else FROM_THE_FRONT)
        for axes in panels[len(kinds) :]:
            axes.set_axis_off()
        print(save(figure, out))


if __name__ == "__main__":
    typer.run(main)
