"""How far are ground forces of walks and of a jump from force plates, in single support, double support and flight?

One set of constants for all trials, joint centres and total mass alone. Root mean square errors in percent of body
weight; by direction of the worse foot, by phase of the vertical force of both. A foot is loaded from .03 body weights
on. Fails where the vertical force of a foot is over its target.
"""

from __future__ import annotations

from typing import Annotated

import numpy as np
import typer
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table

from benchmarks.biomechanics.gait import FORCES
from benchmarks.biomechanics.plate_trials import force_difference, load_trials, loaded_feet
from benchmarks.shared.outcome import Outcome, Verdict
from flexmotion.biomechanics.dynamics import dynamics

TARGETS = {"treadmill walk": 3.8, "ground walk": 3.1, "drop jump": 11.0}
"""Limit of the vertical error of the worse foot [% of body weight]."""

PHASES = ("flight", "single support", "double support")
"""By the number of loaded feet."""


def main(fps: Annotated[float, typer.Option(min=1.0, help="Frame rate to work at.")] = 30.0) -> Outcome:
    """Compute the dynamics of every trial and compare."""
    table = Table("trial", *FORCES, *PHASES, title="RMSE [% of body weight]")
    figures: dict[str, dict[str, float]] = {}
    verdicts = []
    for name, trial in load_trials(fps).items():
        difference = 100 * force_difference(trial, dynamics(trial.motion))
        worse = np.sqrt(np.mean(difference[trial.valid] ** 2, axis=0)).max(axis=0)
        found = {direction: float(worse[axis]) for direction, (axis, _) in FORCES.items()}
        count = loaded_feet(trial)
        found |= {phase: _rms(difference, trial.valid & (count == feet)) for feet, phase in enumerate(PHASES)}
        table.add_row(name, *(f"{value:.2f}" for value in found.values()))
        figures[name] = found
        limit = TARGETS[name]
        vertical = found["vertical"]
        verdicts.append(Verdict(f"{name}: vertical {vertical:.2f} % of body weight (<= {limit})", vertical <= limit))
    Console(width=120).print(table)
    return Outcome(verdicts, figures)


def _rms(difference: NDArray[np.float64], frames: NDArray[np.bool_]) -> float:
    """Of the vertical force of both feet in some frames; not a number without such frames."""
    return float(np.sqrt(np.mean(difference[frames, :, 2] ** 2))) if frames.any() else float("nan")
