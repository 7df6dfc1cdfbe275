"""`footsteps.png`: the walk from above, planned and simulated."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Polygon
from numpy.typing import NDArray

from flexmotion.configs.robot import Robot
from flexmotion.spatial.heading import continuous_heading
from flexmotion.streamer.control.run_trace import RunTrace
from flexmotion.streamer.plots.palette import HUMAN, INK, LEFT, MIDDLE, MUTED, RIGHT
from flexmotion.streamer.plots.style import new_figure
from flexmotion.streamer.report.metrics import HumanTrack, RobotFigures

Float = NDArray[np.float64]

_MARGIN = 0.06
"""Free space around the picture [m]."""


@dataclass(frozen=True)
class Stance:
    """Ticks in which one foot stands: side (0 left, 1 right), first tick, end; sole centre [m] and yaw [rad]."""

    side: int
    start: int
    stop: int
    x: float
    y: float
    yaw: float


def stances(contact: NDArray[np.bool_], feet: Float) -> list[Stance]:
    """Every stance of both feet in order of time; contact (T, 2), feet (T, 2, 4) x, y, z, yaw."""
    found = []
    for side in (0, 1):
        down = contact[:, side] & np.isfinite(feet[:, side]).all(axis=1)
        edges = np.flatnonzero(np.diff(np.concatenate([[False], down, [False]]).astype(int)))
        for start, stop in edges.reshape(-1, 2):
            x, y, _, yaw = np.median(feet[start:stop, side], axis=0)
            found.append(Stance(side, int(start), int(stop), float(x), float(y), float(yaw)))
    return sorted(found, key=lambda stance: stance.start)


def scaled_path(human: HumanTrack, source_s: Float, base: Float, ratio: float) -> Float:
    """The human's path, scaled by leg length, from the robot's first pose on, (K, 2) [m].

    Args:
        source_s: times of the source, (K,) [s].
        base: torso position and quaternion w x y z at the first of them, (7,).
        ratio: leg length of the robot over the human's.
    """
    position, human_heading = human.at(source_s)
    turn = continuous_heading(base[None, 3:])[0] - human_heading[0]
    rotation = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    return base[:2] + ratio * (position[:, :2] - position[0, :2]) @ rotation.T


def draw_footsteps(record: RunTrace, robot: Robot, figures: RobotFigures, human: HumanTrack | None = None) -> Figure:
    """Planned soles (numbered), planned ZMP, DCM and centre of mass, the simulated ones, and the human's path."""
    rows = slice(record.used)
    drawn: list[Float] = []
    feet = stances(record.contact_ref[rows], record.foot_ref[rows])
    paths = [
        (record.zmp_ref[rows], MUTED, "-", 0.8, "ZMP, planned"),
        (record.dcm_ref[rows], HUMAN, ":", 1.0, "DCM, planned"),
        (record.com_ref[rows], INK, "--", 1.2, "centre of mass, planned"),
        (record.true_com[rows, :2], MIDDLE, "-", 1.6, "centre of mass, simulated"),
        (record.true_base[rows, :2], MIDDLE, ":", 1.2, "torso, simulated"),
    ]
    playing = np.flatnonzero(np.isfinite(record.source_s[rows]) & np.isfinite(record.true_base[rows]).all(axis=1))
    human_path = None
    if human is not None and len(playing):
        human_path = scaled_path(human, record.source_s[playing], record.true_base[playing[0]], figures.leg_ratio)
        drawn.append(human_path)
    corners = [_corners(stance, robot) for stance in feet]
    drawn += [path for path, *_ in paths] + corners
    low, high = _bounds(drawn)
    size = high - low
    width = 11.0
    height = float(np.clip(width * size[1] / size[0], 2.6, 8.5)) + 1.3

    figure = new_figure(width, height, "Footsteps from above", "planned soles, left and right; metres; x is forward")
    axes = figure.subplots()
    if human_path is not None:
        label = "human's pelvis, scaled by leg length"
        axes.plot(*human_path.T, color=HUMAN, alpha=0.25, linewidth=7, solid_capstyle="round", label=label)
    _soles(axes, feet, corners)
    for path, colour, style, width_pt, label in paths:
        if np.isfinite(path).any():
            axes.plot(*path.T, color=colour, linestyle=style, linewidth=width_pt, label=label)
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), aspect="equal", anchor="W")
    if axes.get_legend_handles_labels()[0]:
        figure.legend(loc="outside lower left", ncols=3, fontsize=8)
    return figure


def _corners(stance: Stance, robot: Robot) -> Float:
    length, width = robot.sole_half_size[stance.side]
    sole = np.array([[length, width], [-length, width], [-length, -width], [length, -width]])
    cos, sin = np.cos(stance.yaw), np.sin(stance.yaw)
    return np.array([stance.x, stance.y]) + sole @ np.array([[cos, sin], [-sin, cos]])


def _soles(axes: Axes, feet: list[Stance], corners: list[Float]) -> None:
    for number, (stance, outline) in enumerate(zip(feet, corners, strict=True)):
        colour = (LEFT, RIGHT)[stance.side]
        axes.add_patch(Polygon(outline, closed=True, facecolor=colour, alpha=0.10, linewidth=0))
        axes.add_patch(Polygon(outline, closed=True, fill=False, edgecolor=colour, linewidth=0.9))
        x, y = outline[[0, 3]].mean(axis=0)
        axes.text(x, y, str(number + 1), color=colour, fontsize=6.5, ha="right", va="center", alpha=0.8)


def _bounds(drawn: list[Float]) -> tuple[Float, Float]:
    points = np.concatenate([np.zeros((1, 2)), *drawn])
    points = points[np.isfinite(points).all(axis=1)]
    return points.min(axis=0) - _MARGIN, points.max(axis=0) + _MARGIN
