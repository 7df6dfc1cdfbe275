"""Does the simulated human track recorded motion, and recover from pushes, loads and slopes, with little assistance?

The first seconds of every clip of a list are simulated without a perturbation, with a push on the trunk, a mass in the
hands, and on a slope. Shares are of windows of half a second in which the human stays with the motion. The residual is
that of the labels: what the equations of motion leave at the root with ground forces and loads. Fails where walking and
standing are not tracked, the assistance passes its bound, or labels and assistance disagree.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table

from benchmarks.shared.clips import ClipList, ListedClip, extracted
from benchmarks.shared.options import JobsOption
from benchmarks.shared.outcome import Outcome, Verdict
from benchmarks.shared.processes import in_order
from flexmotion.biomechanics.differentiation import EDGE
from flexmotion.biomechanics.simulation.perturbation import Perturbation, PerturbationRanges
from flexmotion.biomechanics.simulation.tracking_model import TRACKING
from flexmotion.biomechanics.simulation.variant import (
    PerturbedMotion,
    TrackingFailedError,
    perturbed,
)
from flexmotion.importers import load
from flexmotion.spatial.gravity import GRAVITY

CLIPS = Path(__file__).with_suffix(".yaml")
PUSH_AT, PUSH_S, PUSH = 1.0, 0.2, 0.08
RECOVERED_S = 0.5
"""Recovery is measured from this long after the push [s]."""

CONDITIONS = ("none", "push", "load", "slope")
TRACKED = {"standing": 0.95, "gesture": 0.95, "walking": 0.75}
"""Least share of windows that are tracked without a perturbation."""

UNEXPLAINED = 0.005
"""Greatest mean residual force of the labels beyond the assistance, where no foot pulled [body weights]."""


@dataclass(frozen=True)
class Run:
    """Figures of one clip under one condition; those after `windows` are None where no window was kept.

    Attributes:
        kind, clip, condition: what ran.
        frames: that were to be simulated.
        seconds: processor time, with what comes before the simulation.
        windows: whether each was tracked.
        recovered: whether the human stayed with the motion to the end, or half a second past the push.
        before, after: RMS distance of the pelvis from the reference before and after the push [m].
        assistance_mean, assistance_max: force at the root [body weights].
        peak: largest vertical ground force, unfiltered [body weights].
        depth: largest penetration [m].
        slip: 95th percentile of the slip of loaded contacts [m/s].
        residual: mean residual force of the labels [body weights].
        unexplained: mean of what that exceeds the mean assistance of the frame by, in frames whose forces were not
            projected (`PerturbedMotion.pulled`) [body weights].
    """

    kind: str
    clip: str
    condition: str
    frames: int
    seconds: float
    windows: tuple[bool, ...]
    recovered: bool
    before: float | None = None
    after: float | None = None
    assistance_mean: float | None = None
    assistance_max: float | None = None
    peak: float | None = None
    depth: float | None = None
    slip: float | None = None
    residual: float | None = None
    unexplained: float | None = None


def condition(name: str, number: int, mass: float) -> Perturbation:
    """The perturbation of a condition; directions differ from clip to clip."""
    angle = 2 * np.pi * ((0.382 * number) % 1.0)
    if name == "push":
        return Perturbation(push=PUSH, direction=angle, start_s=PUSH_AT, duration_s=PUSH_S)
    if name == "load":
        return Perturbation(carried=(("hand_l", 0.04 * mass), ("hand_r", 0.04 * mass)))
    if name == "slope":
        rise = np.tan(np.radians(3.0))
        return Perturbation(slope=(rise * np.cos(angle), rise * np.sin(angle)))
    return Perturbation()


def simulated(task: tuple[int, str, ListedClip], folder: Path, seconds: float) -> Run:
    """One clip under one condition."""
    number, name, clip = task
    motion = load(folder / f"{clip.name}.bvh", fps=30.0)
    motion = motion[: round(seconds * motion.fps) + 1]
    met = condition(name, number, motion.body.mass)
    start = time.process_time()
    try:
        found = perturbed(motion, 0, PerturbationRanges(longest_s=seconds), perturbation=met)
    except TrackingFailedError as error:
        spent = time.process_time() - start
        return Run(clip.kind, clip.name, name, len(motion), spent, error.windows, recovered=False)
    spent = time.process_time() - start
    return figures_of(found, Run(clip.kind, clip.name, name, len(motion), spent, tuple(found.windows), True))


def figures_of(found: PerturbedMotion, run: Run) -> Run:
    """The run with its figures."""
    steps, motion = found.simulation, found.dynamics.motion
    weight = motion.body.mass * GRAVITY
    at = np.arange(len(steps)) / TRACKING.rate
    away = np.linalg.norm(steps.deviation[:, :3], axis=1)
    inner = slice(EDGE, -EDGE)
    residual, helped = found.dynamics.residual[inner, 0], found.assistance[inner, 0]
    carries = steps.wrenches[..., 2].sum(axis=1) > 0.1 * weight

    def rms(chosen: NDArray[np.bool_]) -> float | None:
        return float(np.sqrt(np.mean(away[chosen] ** 2))) if chosen.any() else None

    return Run(
        **{name: getattr(run, name) for name in ("kind", "clip", "condition", "frames", "seconds", "windows")},
        recovered=True,
        before=rms(at < PUSH_AT),
        after=rms(at > PUSH_AT + PUSH_S + RECOVERED_S),
        assistance_mean=float(found.assistance[:, 0].mean()),
        assistance_max=float(found.assistance[:, 0].max()),
        peak=float(steps.wrenches[..., 2].sum(axis=1).max() / weight),
        depth=float(steps.penetration.max()),
        slip=float(np.quantile(steps.slip[carries], 0.95)),
        residual=float(residual.mean()),
        unexplained=float(np.maximum(residual - helped, 0.0)[~found.pulled[inner]].mean()),
    )


def table(runs: Sequence[Run]) -> Table:
    """One row a kind and condition; means over the runs that were kept."""
    found = Table(title="Simulated human (force in body weights)")
    for name in ("kind", "condition", "clips", "kept", "windows", "before cm", "after cm", "assistance", "at most"):
        found.add_column(name)
    for name in ("peak", "depth mm", "slip m/s", "residual", "beyond assistance", "frames/s"):
        found.add_column(name)
    for kind in dict.fromkeys(run.kind for run in runs):
        for name in CONDITIONS:
            row = summary([run for run in runs if run.kind == kind and run.condition == name])
            cells = [f"{value:.3g}" if isinstance(value, float) else str(value) for value in row.values()]
            found.add_row(kind, name, *cells)
    return found


def summary(runs: Sequence[Run]) -> dict[str, Any]:
    """Figures of runs of one kind."""
    windows = [tracked for run in runs for tracked in run.windows]

    def mean(name: str, scale: float = 1.0) -> float | None:
        values = [getattr(run, name) for run in runs if getattr(run, name) is not None]
        return scale * float(np.mean(values)) if values else None

    return {
        "clips": len(runs),
        "kept": sum(run.recovered for run in runs),
        "windows": float(np.mean(windows)) if windows else 0.0,
        "before_cm": mean("before", 100),
        "after_cm": mean("after", 100),
        "assistance": mean("assistance_mean"),
        "assistance_max": max((run.assistance_max or 0.0 for run in runs), default=0.0),
        "peak": mean("peak"),
        "depth_mm": mean("depth", 1e3),
        "slip_m_s": mean("slip"),
        "residual": mean("residual"),
        "unexplained": mean("unexplained"),
        "frames_s": sum(run.frames for run in runs) / max(sum(run.seconds for run in runs), 1e-9),
    }


def verdicts(runs: Sequence[Run]) -> list[Verdict]:
    """The criteria."""
    found = []
    for kind, least in TRACKED.items():
        share = summary([run for run in runs if run.kind == kind and run.condition == "none"])["windows"]
        sentence = f"{kind}: windows tracked without a perturbation {100 * share:.0f} % (>= {100 * least:.0f} %)"
        found.append(Verdict(sentence, share >= least))
    every = summary(runs)
    largest, beyond = every["assistance_max"], every["unexplained"] or 0.0
    bound = TRACKING.assistance
    found.append(Verdict(f"assistance: at most {100 * largest:.2f} % (<= {100 * bound:g} %)", largest <= bound + 1e-9))
    sentence = f"residual force of the labels beyond the assistance: {100 * beyond:.2f} % (<= {100 * UNEXPLAINED:g} %)"
    found.append(Verdict(sentence, beyond <= UNEXPLAINED))
    return found


def main(
    clips: Annotated[Path, typer.Option(help="YAML list of clips by kind and collection.")] = CLIPS,
    seconds: Annotated[float, typer.Option(min=2.5, help="Length that is simulated of each clip [s].")] = 3.0,
    jobs: JobsOption = 1,
) -> Outcome:
    """Simulate every clip under every condition."""
    listed = ClipList(clips)
    tasks = [(number, name, clip) for number, clip in enumerate(listed.clips) for name in CONDITIONS]
    with extracted(listed.by_collection) as folder:
        runs = in_order(partial(simulated, folder=folder, seconds=seconds), tasks, jobs)
    Console(width=190).print(table(runs))
    figures = {
        f"{kind}, {name}": summary([run for run in runs if run.kind == kind and run.condition == name])
        for kind in dict.fromkeys(run.kind for run in runs)
        for name in CONDITIONS
    }
    return Outcome(verdicts(runs), figures)
