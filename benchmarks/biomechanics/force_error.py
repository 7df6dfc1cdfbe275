"""Does the estimated error of a ground force tell how far it is from force plates?

Over the valid frames of the trials (two walks and a drop jump), for both feet. The error of a foot is the length of the
difference between computed and measured force. A frame is *wrong* if the error of a foot is over .2 body weights, else
*good*; it is *flagged* if the estimate of a foot is over `force_error.FLAGGED`. The rank correlation is Spearman's.
Over all feet it is helped by feet in the air, where error and estimate are small; it is also given and judged over
loaded feet (over .03 body weights by the plates), and given for every trial. Errors of loaded feet in units of their
estimates should have a root mean square near 1.

The delivered factors are fitted to all trials at 6, 10 and 15 Hz and 30 frames/s, and are judged by all limits at every
frame rate, at 6 Hz. The estimate must not fall as the cut-off rises. Factors fitted to two trials and tried on the
third are judged by correlation over all feet and wrong frames, and only report the rest: the walks know no landing, and
how much content above 6 Hz means in one follows from the jump alone.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
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
from benchmarks.biomechanics.plate_trials import PLATE_SHARE, force_difference, load_trials
from benchmarks.shared.options import PlotsOption
from benchmarks.shared.outcome import Outcome, Verdict
from flexmotion.biomechanics.dynamics import Dynamics, dynamics
from flexmotion.biomechanics.force_error import FACTORS, FLAGGED, SMALLEST, force_error
from flexmotion.spatial.gravity import GRAVITY

RATES = (30.0, 100.0)
"""Frame rates [1/s]: that of the sets, and that of the plates' trials."""

CUTOFFS = (6.0, 10.0, 15.0)
"""Of the low-pass filter; the first is the usual one [Hz]."""

WRONG = 0.2
"""Error of a foot in a wrong frame [body weights]."""

CORRELATION, WRONG_FLAGGED, GOOD_FLAGGED = 0.5, 0.8, 0.1
"""Limits of the rank correlation and of the flagged shares of wrong and of good frames."""


def main(
    fps: Annotated[list[float] | None, typer.Option(min=1.0, help="Frame rates to work at; 30 and 100.")] = None,
    plots: PlotsOption = None,
) -> Outcome:
    """Compare errors and estimates."""
    table = Table("frames/s", "factors", "trial", "rank correlation", "loaded feet")
    for column in ("error / estimate, RMS", "wrong", "flagged", "good", "flagged"):
        table.add_column(column, justify="right")
    lengths = Table("frames/s", "cut-off [Hz]", "error, RMS over loaded feet [BW]", "estimate")
    figures: dict[str, dict[str, float]] = {}
    verdicts: list[Verdict] = []
    for rate in fps or RATES:
        trials = load_trials(rate)
        found = {cutoff: _compared(trials, cutoff) for cutoff in CUTOFFS}
        usual = found[CUTOFFS[0]]
        delivered = {name: force_error(of.sources) for name, of in usual.items()}
        left_out = {}
        for name, of in usual.items():
            others = [case[other] for case in found.values() for other in trials if other != name]
            left_out[name] = force_error(of.sources, fitted(others))
        for label, estimates in (("delivered", delivered), ("of the other trials", left_out)):
            for name, of in usual.items():
                table.add_row(f"{rate:g}", label, name, *_row(_figures(of, estimates[name])))
            key = f"{label}, {rate:g} frames/s"
            figures[key] = _figures(_together(usual), np.concatenate(list(estimates.values())))
            table.add_row(f"{rate:g}", label, "all", *_row(figures[key]), end_section=True)
            verdicts += _verdicts(key, figures[key], every=label == "delivered")
        estimated = []
        for cutoff, cases in found.items():
            pooled = _together(cases)
            estimated.append(_length(force_error(pooled.sources)[pooled.loaded]))
            error = _length(pooled.errors[pooled.loaded])
            lengths.add_row(f"{rate:g}", f"{cutoff:g}", f"{error:.3f}", f"{estimated[-1]:.3f}")
            figures[f"{cutoff:g} Hz, {rate:g} frames/s"] = {"error_rms": error, "estimate_rms": estimated[-1]}
        given = ", ".join(f"{value:.3f}" for value in estimated)
        rises = bool(np.all(np.diff(estimated) >= 0))
        verdicts.append(Verdict(f"{rate:g} frames/s: estimate at rising cut-offs {given} (does not fall)", rises))
        if plots is not None:
            plots.mkdir(parents=True, exist_ok=True)
            _plot(trials, usual, plots / f"force_error_{rate:g}.png")
    console = Console(width=140)
    console.print(table)
    console.print(lengths)
    return Outcome(verdicts, figures)


@dataclass(frozen=True)
class Compared:
    """Errors and their sources in the valid frames of a trial.

    Attributes:
        errors: length of the error of left and right foot, (T, 2) [body weights].
        sources: of `error_sources`, (T, 2, 6).
        loaded: by the plates, (T, 2) bool.
        dynamics: of all frames; None for several trials together.
    """

    errors: Float
    sources: Float
    loaded: NDArray[np.bool_]
    dynamics: Dynamics | None = None


def _compared(trials: dict[str, GaitTrial], cutoff: float) -> dict[str, Compared]:
    found = {}
    for name, trial in trials.items():
        own = dynamics(trial.motion, cutoff)
        errors = np.linalg.norm(force_difference(trial, own), axis=-1)
        loaded = trial.forces[..., 2] > PLATE_SHARE * trial.motion.body.mass * GRAVITY
        valid = trial.valid
        found[name] = Compared(errors[valid], own.error_sources[valid], loaded[valid], own)
    return found


def _together(cases: dict[str, Compared]) -> Compared:
    errors, sources, loaded = zip(*((of.errors, of.sources, of.loaded) for of in cases.values()), strict=True)
    return Compared(np.concatenate(errors), np.concatenate(sources), np.concatenate(loaded))


def fitted(cases: Sequence[Compared]) -> Float:
    """Factors, (6,), that make errors likely as normal deviates; every case has the same weight."""
    squares = np.concatenate([of.sources.reshape(-1, of.sources.shape[-1]) ** 2 for of in cases])
    wanted = np.concatenate([of.errors.ravel() ** 2 for of in cases]) - SMALLEST**2
    weight = np.concatenate([np.full(of.errors.size, of.errors.size**-0.5) for of in cases])
    variance = FACTORS**2
    for _ in range(30):
        scale = weight / (squares @ variance + SMALLEST**2)
        variance, _ = nnls(squares * scale[:, None], wanted * scale)
    return np.sqrt(variance)


def _figures(of: Compared, estimate: Float) -> dict[str, float]:
    error, loaded = of.errors, of.loaded
    wrong = error.max(axis=1) > WRONG
    flagged = estimate.max(axis=1) > FLAGGED

    def share(of: NDArray[np.bool_]) -> float:
        return float(flagged[of].mean()) if of.any() else float("nan")

    return {
        "rank_correlation": float(spearmanr(error.ravel(), estimate.ravel()).statistic),
        "loaded_rank_correlation": float(spearmanr(error[loaded], estimate[loaded]).statistic),
        "relative_rms": _length(error[loaded] / estimate[loaded]),
        "wrong_frames": float(wrong.sum()),
        "wrong_flagged": share(wrong),
        "good_frames": float((~wrong).sum()),
        "good_flagged": share(~wrong),
    }


def _length(values: Float) -> float:
    """Root mean square."""
    return float(np.sqrt(np.mean(values**2)))


def _row(found: dict[str, float]) -> list[str]:
    correlation, loaded, rms, wrong, of_wrong, good, of_good = found.values()
    shares = [f"{wrong:.0f}", f"{of_wrong:.0%}" if wrong else "-", f"{good:.0f}", f"{of_good:.1%}"]
    return [f"{correlation:.2f}", f"{loaded:.2f}", f"{rms:.2f}", *shares]


def _verdicts(label: str, found: dict[str, float], every: bool) -> list[Verdict]:
    """Limits of a row; without `every` those of factors that do not know the trial."""
    correlation, loaded = found["rank_correlation"], found["loaded_rank_correlation"]
    wrong, good = found["wrong_flagged"], found["good_flagged"]
    some = [
        Verdict(f"{label}: rank correlation {correlation:.2f} (>= {CORRELATION})", correlation >= CORRELATION),
        Verdict(f"{label}: wrong frames flagged {wrong:.0%} (>= {WRONG_FLAGGED:.0%})", wrong >= WRONG_FLAGGED),
    ]
    if not every:
        return some
    return [
        *some,
        Verdict(f"{label}: good frames flagged {good:.1%} (<= {GOOD_FLAGGED:.0%})", good <= GOOD_FLAGGED),
        Verdict(f"{label}: loaded feet, rank correlation {loaded:.2f} (>= {CORRELATION})", loaded >= CORRELATION),
    ]


def _plot(trials: dict[str, GaitTrial], cases: dict[str, Compared], path: Path) -> None:
    """Errors and their estimates over time."""
    from flexmotion.streamer.plots.palette import INK, LEFT
    from flexmotion.streamer.plots.style import new_figure, save, styled

    with styled():
        figure = new_figure(12, 6, "Error of the ground force", "found black, estimated blue [% of body weight]")
        rows = figure.subplots(2, len(trials))
        for column, (name, trial) in enumerate(trials.items()):
            found = cases[name].dynamics
            assert found is not None
            error = np.linalg.norm(force_difference(trial, found), axis=-1)
            error[~trial.valid] = np.nan
            for side, foot in enumerate(("left", "right")):
                axes = rows[side, column]
                axes.plot(trial.times, 100 * error[:, side], color=INK)
                axes.plot(trial.times, 100 * found.force_error[:, side], color=LEFT)
                axes.set_title(f"{name}, {foot}")
                axes.set_xlabel("time [s]")
        save(figure, path)
