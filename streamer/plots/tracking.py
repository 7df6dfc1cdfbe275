"""`tracking.png`: reference and measurement of each joint."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from flexmotion.configs.robot import Robot
from flexmotion.streamer.control.run_trace import RunTrace
from flexmotion.streamer.plots.palette import INK, MUTED, WARN
from flexmotion.streamer.plots.panels import joint_columns, joint_panels
from flexmotion.streamer.plots.style import new_figure, side_colour

_LEAST_SPAN_DEG = 10.0
"""Smallest range of a panel, so that noise of a still joint does not look like motion."""


def draw_tracking(record: RunTrace, robot: Robot) -> Figure:
    """Reference (broad, grey) under measurement (thin, coloured by side) of every joint, with its RMS difference."""
    rows = max(map(len, joint_columns(robot)))
    figure = new_figure(
        11,
        1.0 + 1.35 * rows,
        "Tracking",
        "broad grey: reference; thin: measured; degrees over seconds; right corner: RMS difference; red: joint limit",
        layout=False,
    )
    t = record.time_s
    reference, measured = np.degrees(record.q_ref[: record.used]), np.degrees(record.q[: record.used])
    lower, upper = np.degrees(robot.lower), np.degrees(robot.upper)
    for joint, axes in joint_panels(figure, robot, above=0.75, sharex=True, sharey=False).items():
        axes.plot(t, reference[:, joint], color=INK, alpha=0.28, linewidth=3.2, solid_capstyle="butt")
        axes.plot(t, measured[:, joint], color=side_colour(robot.joint_names[joint]), linewidth=0.9)
        error = measured[:, joint] - reference[:, joint]
        error = error[np.isfinite(error)]
        if len(error):
            rms = f"{np.sqrt(np.mean(error**2)):.1f}°"
            axes.text(0.99, 1.03, rms, transform=axes.transAxes, ha="right", va="bottom", fontsize=7.5, color=MUTED)
        low, high = axes.get_ylim()
        missing = max(_LEAST_SPAN_DEG - (high - low), 0.0) / 2
        axes.set_ylim(low - missing, high + missing)
        for limit in (lower[joint], upper[joint]):
            if low - missing <= limit <= high + missing:
                axes.axhline(limit, color=WARN, linewidth=0.8)
        axes.set_xlim(*((t[0], max(t[-1], t[0] + 1e-3)) if len(t) else (0, 1)))
    return figure
