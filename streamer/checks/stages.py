"""Times of a run's stages, of all moments and of those in which the machine kept its pace, with their budgets."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from flexmotion.configs.stream import Budgets
from flexmotion.streamer.checks.latency_result import MOST_LEFT_OUT, Bound, Stage
from flexmotion.streamer.checks.machine_pace import MachinePace
from flexmotion.streamer.control.run_trace import RunTrace
from flexmotion.streamer.report.report import Latency

Float = NDArray[np.float64]


def stage(seconds: Float, *bounds: Bound) -> Stage:
    """A stage of all moments, (k,) [s]."""
    return Stage(Latency.of(seconds, 1e-3), bounds)


def of_ticks(pace: MachinePace | None, seconds: Float, *bounds: Bound, after: Float | float = 0.0) -> Stage:
    """A stage that ends in ticks.

    Args:
        pace: of the machine; None: not known.
        seconds, after: see `MachinePace.apart`.
    """
    if pace is None:
        return stage(seconds, *bounds)
    kept, measured = pace.apart(seconds, after), int(np.isfinite(seconds).sum())
    left_out = 1.0 - np.isfinite(kept).sum() / measured if measured else 0.0
    return Stage(Latency.of(seconds, 1e-3), bounds, Latency.of(kept, 1e-3), float(left_out))


def target_to_command(record: RunTrace, budgets: Budgets, pace: MachinePace | None) -> Stage:
    """From the arrival of a target to the first command of a plan that follows it."""
    return of_ticks(
        pace,
        record.target_to_command_s,
        Bound("p95", budgets.target_to_command_ms, "all"),
        Bound("p50", budgets.target_to_command_p50_ms, "kept"),
        Bound("p99", budgets.target_to_command_p99_ms, "kept"),
    )


def unfit(pace: MachinePace, command: Stage) -> str:
    """Why too much is left out for a verdict; empty where it is not.

    Args:
        command: of `target_to_command`.
    """
    found = [
        f"{100 * share:.0f} % of the {what}"
        for what, share in (("ticks", pace.left_out), ("targets", command.left_out))
        if share > MOST_LEFT_OUT
    ]
    allowed = f"at most {100 * MOST_LEFT_OUT:.0f} % may be left out"
    return f"the machine did not keep its pace in {' and '.join(found)}, {allowed}" if found else ""
