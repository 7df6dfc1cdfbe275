"""`latency.png`: distributions of the loop's lateness and of the stages' times."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from flexmotion.streamer.checks.latency_result import HISTOGRAM_US, LatencyResult
from flexmotion.streamer.plots.palette import LEFT, MUTED, RIGHT, WARN
from flexmotion.streamer.plots.style import new_figure, save, styled


def draw_latency(result: LatencyResult) -> Figure:
    """Left: ticks by lateness, on a logarithmic scale. Right: each stage from its median to its maximum."""
    figure = new_figure(
        10.0,
        4.2,
        f"Latency over {result.seconds:.0f} s at {result.rate_hz:g} Hz ({result.scheduling}, {result.load} hogs)",
        "left: how late the loop woke; right: median, 99th percentile and maximum of each stage, budgets in red",
    )
    left, right = figure.subplots(1, 2, width_ratios=(1.1, 1.0))
    edges = [f"{edge:g}" for edge in HISTOGRAM_US]
    left.bar(edges, np.maximum(result.lateness, 0.5), color=LEFT, align="edge", width=0.95)
    left.set_yscale("log")
    left.set_ylim(bottom=0.5)
    left.tick_params(axis="x", rotation=60)
    left.set_xlabel("late by at least [µs]")
    left.set_ylabel("ticks")
    names = [name for name, stage in result.stages.items() if stage.time is not None]
    for row, name in enumerate(names):
        stage = result.stages[name]
        if stage.time is None:
            continue
        time = stage.time
        right.plot([max(time.p50, 1e-3), max(time.max, 1e-3)], [row, row], color=MUTED, linewidth=1.0)
        right.plot(max(time.p50, 1e-3), row, "o", color=LEFT, markersize=5)
        right.plot(max(time.p99, 1e-3), row, "D", color=RIGHT, markersize=4)
        for bound in stage.bounds:
            right.plot([bound.ms] * 2, [row - 0.35, row + 0.35], color=WARN, linewidth=2.0)
    right.set_xscale("log")
    right.set_yticks(range(len(names)), names)
    right.invert_yaxis()
    right.set_xlabel("[ms]")
    return figure


def write_latency(file: Path, result: LatencyResult) -> Path:
    """Draw the picture of `check latency` into a PNG file; see `draw_latency`."""
    with styled():
        return save(draw_latency(result), file)
