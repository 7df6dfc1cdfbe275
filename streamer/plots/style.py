"""The style of all pictures, by matplotlib's object interface alone: no global state, no screen."""

from __future__ import annotations

from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any

import matplotlib as mpl
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from flexmotion.streamer.plots.palette import FAINT, INK, LEFT, MIDDLE, MUTED, RIGHT

_STYLE: Any = {
    "figure.dpi": 110,
    "figure.facecolor": "white",
    "font.size": 9,
    "axes.edgecolor": MUTED,
    "axes.labelcolor": INK,
    "axes.titlesize": 9,
    "axes.titlelocation": "left",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.linewidth": 0.8,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": FAINT,
    "grid.linewidth": 0.7,
    "xtick.color": MUTED,
    "ytick.color": MUTED,
    "text.color": INK,
    "legend.frameon": False,
    "lines.linewidth": 1.2,
}


def styled() -> AbstractContextManager[None]:
    """Context in which figures have the project's style."""
    return mpl.rc_context(_STYLE)


def new_figure(width: float, height: float, title: str, subtitle: str, *, layout: bool = True) -> Figure:
    """An empty figure [inch] with a title and a subtitle that explains it.

    `layout` computes the margins; with dozens of panels that takes seconds, so those place their panels themselves.
    """
    figure = Figure(figsize=(width, height), layout="constrained" if layout else None)
    FigureCanvasAgg(figure)
    # The title's second line is left empty, so that the layout keeps room for the subtitle.
    top = None if layout else 1 - 0.05 / height
    figure.suptitle(f"{title}\n ", x=0.01, y=top, ha="left", va="top", fontsize=11, fontweight="bold")
    figure.text(0.01, 1 - 0.27 / height, subtitle, ha="left", va="top", fontsize=9, color=MUTED)
    return figure


def save(figure: Figure, file: Path) -> Path:
    """Write a PNG whose bytes depend only on the picture: no date, no version."""
    figure.savefig(file, metadata={"Software": None})
    return file


def side_colour(joint: str) -> str:
    """Colour of a joint by its name."""
    name = joint.lower()
    if name.startswith(("l_", "left")):
        return LEFT
    if name.startswith(("r_", "right")):
        return RIGHT
    return MIDDLE


def empty(axes: Axes, text: str) -> None:
    """Leave a panel empty, with the reason as text."""
    axes.set_axis_off()
    axes.text(0.5, 0.5, text, ha="center", va="center", color=MUTED, transform=axes.transAxes)
