"""`timeline.png`: state, feet, balance and heading over time."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from flexmotion.spatial.heading import continuous_heading
from flexmotion.spatial.tilt import tilt_of
from flexmotion.streamer.control.ladder import State
from flexmotion.streamer.control.run_totals import FALL_TILT_RAD
from flexmotion.streamer.control.run_trace import RunTrace
from flexmotion.streamer.plots.palette import FAINT, HUMAN, INK, LEFT, MIDDLE, MUTED, RIGHT, WARN
from flexmotion.streamer.plots.style import empty, new_figure
from flexmotion.streamer.report.metrics import HumanTrack, RobotFigures

Float = NDArray[np.float64]

_STATE_COLOURS = {
    State.OFF: "#cbd5e1",
    State.READY: "#fde68a",
    State.STREAMING: "#86c5a4",
    State.HOLD: "#9ec9ea",
    State.PARK: "#d9c2ee",
    State.DAMPED: "#f4a582",
    State.FAULT: "#e58080",
    State.GET_UP: "#c9b98f",
}
_LABELLED_SHARE = 0.04
"""Bands shorter than this share of the run have no label."""
_MOST_LABELS = 12


def draw_timeline(record: RunTrace, figures: RobotFigures, human: HumanTrack | None = None) -> Figure:
    """Ladder state and events, load on each foot over planned contact, torso tilt, leg error, heading."""
    t = record.time_s
    figure = new_figure(11, 8.2, "Timeline", "state, feet, and distance from the plan")
    panels = figure.subplots(5, 1, sharex=True, height_ratios=(0.7, 1.2, 1, 1, 1))
    _states(panels[0], record, t)
    _feet(panels[1], record, figures, t)
    _tilt(panels[2], record, t)
    _error(panels[3], record, figures, t)
    _heading(panels[4], record, human, t)
    panels[-1].set_xlabel("time [s]")
    panels[-1].set_xlim(*((t[0], t[-1] + 1 / record.rate_hz) if len(t) else (0, 1)))
    return figure


def _spans(values: NDArray[np.int64]) -> list[tuple[int, int, int]]:
    """Runs of equal values: value, first index, end."""
    edges = np.concatenate([[0], np.flatnonzero(np.diff(values)) + 1, [len(values)]])
    return [(int(values[a]), int(a), int(b)) for a, b in pairwise(edges) if a < b]


def _states(axes: Axes, record: RunTrace, t: Float) -> None:
    begin, end = record.period_s
    for value, start, stop in _spans(record.state[: record.used]):
        state = State(value)
        axes.axvspan(
            begin + start / record.rate_hz, begin + stop / record.rate_hz, color=_STATE_COLOURS[state], linewidth=0
        )
        if stop - start >= _LABELLED_SHARE * record.used:
            middle = begin + (start + stop) / 2 / record.rate_hz
            axes.text(middle, 0.5, state.name, ha="center", va="center", fontsize=8)
    # A text beside the panels would leave them no room.
    drawn = [event for event in record.events if begin <= event.tick / record.rate_hz <= end]
    notable = [event for event in drawn if event.kind != "state"]
    for event in notable:
        colour = WARN if event.kind == "fault" else INK
        axes.axvline(event.tick / record.rate_hz, ymin=0.0, ymax=1.0, color=colour, linewidth=0.8)
    for event in notable[:_MOST_LABELS]:
        axes.text(event.tick / record.rate_hz, 1.04, event.kind, fontsize=7, color=MUTED, rotation=30, va="bottom")
    axes.set(yticks=[], ylim=(0, 1), ylabel="state")


def _feet(axes: Axes, record: RunTrace, figures: RobotFigures, t: Float) -> None:
    for side, (colour, name) in enumerate(((LEFT, "left"), (RIGHT, "right"))):
        planned = record.contact_ref[: record.used, side]
        base = 1.0 - side
        axes.fill_between(t, base, base + 0.92 * planned, step="post", color=colour, alpha=0.15, linewidth=0)
        load = record.true_foot_force[: record.used, side, 2] / figures.weight
        axes.plot(t, base + 0.92 * np.clip(load, 0, 1.05), color=colour, linewidth=0.9)
        axes.text(0.002, base + 0.8, name, color=colour, fontsize=8, transform=axes.get_yaxis_transform())
    axes.set(ylim=(0, 2), yticks=[], ylabel="load")
    axes.axhline(1, color=FAINT, linewidth=1)
    _note(axes, "shaded: planned contact; line: share of weight")


def _tilt(axes: Axes, record: RunTrace, t: Float) -> None:
    base = record.true_base[: record.used]
    axes.plot(t, np.degrees(tilt_of(base[:, 3:])), color=MIDDLE)
    axes.plot(t, np.degrees(tilt_of(record.base_ref[: record.used, 3:])), color=INK, linestyle="--", linewidth=0.9)
    axes.axhline(np.degrees(FALL_TILT_RAD), color=WARN, linewidth=0.8)
    axes.set(ylabel="torso tilt °", ylim=(0, 80))
    _note(axes, "dashed: planned; red: fallen, unless it bows as planned")


def _error(axes: Axes, record: RunTrace, figures: RobotFigures, t: Float) -> None:
    rows = slice(record.used)
    error = np.degrees(np.abs(record.q[rows, figures.legs] - record.q_ref[rows, figures.legs]))
    axes.fill_between(t, error.max(axis=1), color=MIDDLE, alpha=0.2, linewidth=0)
    axes.plot(t, error.mean(axis=1), color=MIDDLE)
    axes.set(ylabel="leg error °", ylim=(0, None))
    _note(axes, "line: mean of the leg joints; shaded: worst joint; lag included")


def _heading(axes: Axes, record: RunTrace, human: HumanTrack | None, t: Float) -> None:
    base = record.true_base[: record.used]
    known = np.isfinite(base).all(axis=1)
    if not known.any():
        empty(axes, "this driver does not measure the robot's heading")
        return
    playing = known & np.isfinite(record.source_s[: record.used])
    robot = np.full(record.used, np.nan)
    robot[known] = continuous_heading(base[known, 3:])
    robot -= robot[playing][0] if playing.any() else robot[known][0]
    axes.plot(t, np.degrees(robot), color=MIDDLE)
    if human is not None and playing.any():
        _, yaw = human.at(record.source_s[: record.used][playing])
        axes.plot(t[playing], np.degrees(yaw - yaw[0]), color=HUMAN, alpha=0.4, linewidth=3)
    low, high = axes.get_ylim()
    axes.set(ylabel="heading °", ylim=(min(low, -10), max(high, 10)))
    _note(axes, "robot; broad: human")


def _note(axes: Axes, text: str) -> None:
    axes.set_title(text, loc="right", pad=2, fontsize=7.5, color=MUTED)
