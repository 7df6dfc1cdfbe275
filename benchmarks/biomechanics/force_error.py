"""Does the estimated error of a ground force tell how far it is from force plates?

Over the valid frames of the trials (two walks and a drop jump), for both feet. The error of a foot is the length of the
difference between computed and measured force. A frame is *wrong* if the error of a foot is over .2 body weights, else
*good*; it is *flagged* if the estimate of a foot is over `force_error.FLAGGED`. The rank correlation is Spearman's,
over feet and frames of all trials. The delivered factors are fitted to all trials and are judged by all limits. Factors
fitted to two trials and tried on the third are judged by correlation and wrong frames, and only report the good frames:
the walks know no landing, and how much removed content means in one follows from the jump alone. Errors in units of
their estimates should have a root mean square near 1.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table
from scipy.optimize import nnls
from scipy.stats import spearmanr

from benchmarks.biomechanics.gait_trial import Float, GaitTrial
from benchmarks.biomechanics.plate_trials import force_difference, load_trials
from benchmarks.shared.options import PlotsOption
from benchmarks.shared.outcome import Outcome, Verdict
from flexmotion.biomechanics.dynamics import Dynamics, dynamics
from flexmotion.biomechanics.force_error import FACTORS, FLAGGED, SMALLEST, force_error

WRONG = 0.2
"""Error of a foot in a wrong frame [body weights]."""

CORRELATION, WRONG_FLAGGED, GOOD_FLAGGED = 0.5, 0.8, 0.1
"""Limits of the rank correlation and of the flagged shares of wrong and of good frames."""


def main(
    fps: Annotated[float, typer.Option(min=1.0, help="Frame rate to work at.")] = 30.0, plots: PlotsOption = None
) -> Outcome:
    """Compare errors and estimates."""
    trials = load_trials(fps)
    found = {name: dynamics(trial.motion) for name, trial in trials.items()}
    errors, sources = {}, {}
    for name, trial in trials.items():
        errors[name] = np.linalg.norm(force_difference(trial, found[name]), axis=-1)[trial.valid]
        sources[name] = found[name].error_sources[trial.valid]
    delivered = {name: force_error(value) for name, value in sources.items()}
    left_out = {}
    for name, value in sources.items():
        others = [other for other in trials if other != name]
        left_out[name] = force_error(value, fitted([sources[n] for n in others], [errors[n] for n in others]))

    table = Table(
        "factors", "trial", "rank correlation", "error / estimate, RMS", "wrong", "flagged", "good", "flagged"
    )
    figures: dict[str, dict[str, float]] = {}
    verdicts = []
    for label, estimates in (("delivered", delivered), ("of the other trials", left_out)):
        for name in trials:
            table.add_row(label, name, *_row(errors[name], estimates[name]))
        pooled, estimate = np.concatenate(list(errors.values())), np.concatenate(list(estimates.values()))
        table.add_row(label, "all", *_row(pooled, estimate), end_section=True)
        figures[label] = _figures(pooled, estimate)
        verdicts += _verdicts(label, figures[label])[: None if label == "delivered" else 2]
    Console(width=120).print(table)
    if plots is not None:
        plots.mkdir(parents=True, exist_ok=True)
        _plot(trials, found, plots / "force_error.png")
    return Outcome(verdicts, figures)


def fitted(sources: list[Float], errors: list[Float]) -> Float:
    """Factors, (5,), that make errors likely as normal deviates; every trial has the same weight."""
    squares = np.concatenate([value.reshape(-1, value.shape[-1]) ** 2 for value in sources])
    wanted = np.concatenate([value.ravel() ** 2 for value in errors]) - SMALLEST**2
    weight = np.concatenate([np.full(value.size, value.size**-0.5) for value in errors])
    variance = FACTORS**2
    for _ in range(30):
        scale = weight / (squares @ variance + SMALLEST**2)
        variance, _ = nnls(squares * scale[:, None], wanted * scale)
    return np.sqrt(variance)


def _figures(error: Float, estimate: Float) -> dict[str, float]:
    wrong = error.max(axis=1) > WRONG
    flagged = estimate.max(axis=1) > FLAGGED

    def share(of: NDArray[np.bool_]) -> float:
        return float(flagged[of].mean()) if of.any() else float("nan")

    return {
        "rank_correlation": float(spearmanr(error.ravel(), estimate.ravel()).statistic),
        "relative_rms": float(np.sqrt(np.mean((error / estimate) ** 2))),
        "wrong_frames": float(wrong.sum()),
        "wrong_flagged": share(wrong),
        "good_frames": float((~wrong).sum()),
        "good_flagged": share(~wrong),
    }


def _row(error: Float, estimate: Float) -> list[str]:
    correlation, rms, wrong, of_wrong, good, of_good = _figures(error, estimate).values()
    return [f"{correlation:.2f}", f"{rms:.2f}", f"{wrong:.0f}", f"{of_wrong:.0%}", f"{good:.0f}", f"{of_good:.1%}"]


def _verdicts(label: str, found: dict[str, float]) -> list[Verdict]:
    correlation, wrong, good = found["rank_correlation"], found["wrong_flagged"], found["good_flagged"]
    return [
        Verdict(f"{label}: rank correlation {correlation:.2f} (>= {CORRELATION})", correlation >= CORRELATION),
        Verdict(f"{label}: wrong frames flagged {wrong:.0%} (>= {WRONG_FLAGGED:.0%})", wrong >= WRONG_FLAGGED),
        Verdict(f"{label}: good frames flagged {good:.1%} (<= {GOOD_FLAGGED:.0%})", good <= GOOD_FLAGGED),
    ]


def _plot(trials: dict[str, GaitTrial], found: dict[str, Dynamics], path: Path) -> None:
    """Errors and their estimates over time."""
    from flexmotion.streamer.plots.palette import INK, LEFT
    from flexmotion.streamer.plots.style import new_figure, save, styled

    with styled():
        figure = new_figure(12, 6, "Error of the ground force", "found black, estimated blue [% of body weight]")
        rows = figure.subplots(2, len(trials))
        for column, (name, trial) in enumerate(trials.items()):
            error = np.linalg.norm(force_difference(trial, found[name]), axis=-1)
            error[~trial.valid] = np.nan
            for side, foot in enumerate(("left", "right")):
                axes = rows[side, column]
                axes.plot(trial.times, 100 * error[:, side], color=INK)
                axes.plot(trial.times, 100 * found[name].force_error[:, side], color=LEFT)
                axes.set_title(f"{name}, {foot}")
                axes.set_xlabel("time [s]")
        save(figure, path)
