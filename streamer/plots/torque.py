"""`torque.png`: torque of each servo and its limits."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from flexmotion.configs.envelope import Envelope
from flexmotion.configs.robot import Robot
from flexmotion.streamer.plots.palette import FAINT, INK, MUTED, WARN
from flexmotion.streamer.plots.panels import joint_columns, joint_panels
from flexmotion.streamer.plots.style import empty, new_figure, save, side_colour, styled

Float = NDArray[np.float64]

CONTINUOUS_SHARE = 0.3
"""Share of stall torque that a servo's RMS torque should not exceed in long runs (aim for the project's robots)."""


def draw_torque(torque: Float, speed: Float, robot: Robot, *, measured: bool = False) -> Figure:
    """RMS and peak of every joint, then every tick of every joint in the torque-speed plane.

    Args:
        torque, speed: (T, n) [N·m, rad/s]; NaN where unknown.
        measured: whether the servos measured the torque.
    """
    rows = max(map(len, joint_columns(robot)))
    height = 3.9 + 1.45 * rows
    figure = new_figure(
        11,
        height,
        "Torque, measured by the servos" if measured else "Torque",
        "bars: RMS and peak against stall, usable and continuous torque; below: torque [N·m] over speed [rad/s], "
        "shaded: the servo's envelope",
        layout=False,
    )
    bars = figure.add_axes((0.045, 1 - 2.6 / height, 0.945, 1.95 / height))
    _bars(bars, robot, torque, [i for column in joint_columns(robot) for i in column])
    panels = joint_panels(figure, robot, above=3.6, sharex=True, sharey=True)
    for joint, axes in panels.items():
        _plane(axes, robot, joint, torque[:, joint], speed[:, joint])
    fastest, strongest = 1.15 * robot.no_load_speed.max(), 1.1 * robot.stall_torque.max()
    panels[0].set(xlim=(-fastest, fastest), ylim=(-strongest, strongest))
    return figure


def write_torque(file: Path, torque: Float, speed: Float, robot: Robot) -> Path:
    """Draw the picture of torques alone into a PNG file; see `draw_torque`."""
    with styled():
        return save(draw_torque(torque, speed, robot), file)


def _bars(axes: Axes, robot: Robot, torque: Float, order: list[int]) -> None:
    known = np.isfinite(torque)
    if not known.any():
        empty(axes, "this driver does not measure torque")
        return
    count = np.maximum(known.sum(axis=0), 1)
    rms = np.sqrt(np.sum(torque**2, axis=0, where=known) / count)[order]
    peak = np.abs(torque).max(axis=0, where=known, initial=0.0)[order]
    x = np.arange(len(order))
    colours = [side_colour(robot.joint_names[i]) for i in order]
    axes.bar(x, peak, width=0.72, color=colours, alpha=0.25)
    axes.bar(x, rms, width=0.72, color=colours)
    lines = {
        "stall": (robot.stall_torque[order], INK, "-"),
        "usable": (robot.usable_torque[order], MUTED, "-"),
        f"{CONTINUOUS_SHARE:.0%} of stall": (CONTINUOUS_SHARE * robot.stall_torque[order], WARN, "--"),
    }
    for label, (level, colour, style) in lines.items():
        axes.hlines(level, x - 0.5, x + 0.5, color=colour, linestyle=style, linewidth=1)
        axes.text(x[-1] + 0.6, level[-1], label, color=colour, va="center", fontsize=8)
    axes.set_xticks(x, [robot.joint_names[i] for i in order], rotation=35, ha="right", fontsize=8)
    axes.set_xlim(-0.6, len(order) + 1.2)
    axes.set_ylabel("N·m")
    axes.set_ylim(0, 1.06 * max(robot.stall_torque.max(), peak.max()))
    axes.grid(axis="x", visible=False)


def _plane(axes: Axes, robot: Robot, joint: int, torque: Float, speed: Float) -> None:
    axes.fill(*Envelope.of(robot).corners(joint), color=FAINT, linewidth=0)
    axes.axhline(0, color=MUTED, linewidth=0.5)
    axes.axvline(0, color=MUTED, linewidth=0.5)
    axes.grid(visible=False)
    axes.scatter(speed, torque, s=2.5, color=side_colour(robot.joint_names[joint]), alpha=0.25, linewidths=0)
