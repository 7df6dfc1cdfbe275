"""Which corrections does a bundle need, so that it moves as it is asked to?

Two things are fitted to samples from standing. `speeds`: the mean velocity of every kind of motion that travels, asked
for by its wordings alone. Sideways: gain, the forward velocity and the turning that come with it, by a few rounds over
velocities without and with a forward part; the round with the least error is kept. The other corrections stay as they
are. `--write` puts the found ones into the bundle. Fails where sideways velocities are missed by more than .15 m/s or
.2 rad/s.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from numpy.typing import NDArray
from rich.console import Console
from rich.progress import track
from rich.table import Table

from benchmarks.model.roll_out import always, roll_out
from benchmarks.shared.judges import frame_velocities
from benchmarks.shared.model import open_bundle
from benchmarks.shared.options import BundleArgument, WriteOption
from benchmarks.shared.outcome import Outcome, Verdict
from flexmotion.bundles.bundle import Bundle
from flexmotion.bundles.manifest import MANIFEST, write_manifest
from flexmotion.configs.corrections import Corrections, Velocity
from flexmotion.configs.errors import ConfigError
from flexmotion.sampling.sampler import Sampler
from flexmotion.text import phrases

Float = NDArray[np.float64]

WORDINGS = 6
"""Of a kind of motion, of those that it has."""
TRAVELS = 0.35, 0.4
"""A kind travels where its samples move or turn faster than this [m/s, rad/s]."""
SIDEWAYS = tuple((ahead, aside, 0.0) for ahead in (0.0, 0.25) for aside in (-0.3, -0.2, 0.2, 0.3))
"""Velocities by which the sideways corrections are fitted [m/s, m/s, rad/s]."""
ROUNDS, STEP = 5, 0.7
"""Rounds of the fit, and the share of what is missing that a round adds."""
MOST_GAIN = 3.0
LIMITS = 0.15, 0.2
SETTLE_S = 1.0
"""Time in which a body speeds up [s]."""
GRID = 0.05
"""Corrections are rounded to this: samples do not tell them more finely."""


def sampler_with(bundle: Bundle, corrections: Corrections) -> Sampler:
    """A sampler of a bundle, of all kinds that it knows, with other corrections."""
    bundle.manifest = bundle.manifest.model_copy(update={"corrections": corrections})
    return Sampler(bundle, unjudged=True)


def settled(
    sampler: Sampler, seconds: float, seed: int, *, text: str | None = None, velocity: Velocity | None = None
) -> Float:
    """Mean velocity of a sample after the first second: forward, left [m/s], turning left [rad/s]."""
    motion = roll_out(sampler, always(text, velocity), SETTLE_S + seconds, seed).motion
    found: Float = frame_velocities(motion)[-round(seconds * sampler.fps) :].mean(axis=0)
    return found


def speeds(sampler: Sampler, samples: int, seconds: float) -> dict[str, Velocity]:
    """Velocity of every kind of motion that travels by its words alone; those that mean a velocity are left out."""
    found = {}
    for kind in track(sorted(set(sampler.bundle.prompts.kinds)), "kinds", console=Console(stderr=True)):
        if phrases.velocity(kind) is not None:
            continue
        texts = phrases.wordings(kind)[:WORDINGS]
        draws = [settled(sampler, seconds, seed, text=texts[seed % len(texts)]) for seed in range(samples)]
        # The median: a wording that is taken for another kind must not pull the mean.
        forward, _, turning = (float(value) for value in _rounded(np.median(draws, axis=0)))
        # Words that mean sideways motion mean a velocity: what else goes aside is sway, and drift without a course.
        if abs(forward) > TRAVELS[0] or abs(turning) > TRAVELS[1]:
            found[kind] = (forward, 0.0, turning if abs(turning) > TRAVELS[1] else 0.0)
    return found


def responses(sampler: Sampler, samples: int, seconds: float) -> Float:
    """Mean velocities of the samples of `SIDEWAYS`, (commands, 3)."""
    return np.array(
        [
            np.mean([settled(sampler, seconds, seed, velocity=command) for seed in range(samples)], axis=0)
            for command in SIDEWAYS
        ]
    )


def errors(found: Float) -> tuple[float, float]:
    """Mean error of responses: speed [m/s] and turning [rad/s]."""
    apart = found - np.array(SIDEWAYS)
    return float(np.hypot(apart[:, 0], apart[:, 1]).mean()), float(np.abs(apart[:, 2]).mean())


def improved(corrections: Corrections, found: Float) -> Corrections:
    """The corrections after one round, by the responses that were found with them."""
    asked = np.array(SIDEWAYS)
    aside, side = np.abs(asked[:, 1]), np.sign(asked[:, 1])
    gain = float(np.clip((found[:, 1] * side).sum() / aside.sum(), 1 / MOST_GAIN, MOST_GAIN))
    ahead = float((found[:, 0] - asked[:, 0]).sum() / aside.sum())
    turning = float((found[:, 2] * side).sum() / aside.sum())
    return corrections.model_copy(
        update={
            "aside": min(float(corrections.aside * gain**-STEP), MOST_GAIN),
            "ahead_per_aside": corrections.ahead_per_aside + STEP * ahead,
            "turning_per_aside": corrections.turning_per_aside - STEP * turning,
        }
    )


def _rounded(values: Float) -> Float:
    return np.round(np.round(values / GRID) * GRID, 3)


def main(
    bundle: BundleArgument = None,
    samples: Annotated[int, typer.Option(min=1, help="Of each kind and each velocity.")] = 8,
    seconds: Annotated[float, typer.Option(min=0.5, help="Length of the judged motion [s].")] = 4.0,
    write: WriteOption = False,
) -> Outcome:
    """Fit the corrections of a bundle."""
    opened = open_bundle(bundle)
    if not opened.manifest.velocity:
        raise ConfigError(f"{opened.folder}: this bundle does not follow velocities")
    console, tried = Console(width=120), opened.manifest.corrections
    table = Table(title="Sideways velocities: corrections, and mean errors")
    for name in ("round", "aside", "ahead per aside", "turning per aside", "speed m/s", "turning rad/s"):
        table.add_column(name, justify="right")
    best, least, before = tried, (np.inf, np.inf), None
    for number in track(range(ROUNDS), "rounds", console=Console(stderr=True)):
        found = responses(sampler_with(opened, tried), samples, seconds)
        error = errors(found)
        before = before or error
        fitted = (tried.aside, tried.ahead_per_aside, tried.turning_per_aside)
        table.add_row(str(number), *(f"{value:.2f}" for value in (*fitted, *error)))
        if sum(error) < sum(least):
            best, least = tried, error
        tried = improved(tried, found)
    console.print(table)
    assert before is not None
    best = best.model_copy(update={"speeds": speeds(sampler_with(opened, best), samples, seconds)})
    for kind, (forward, _, turning) in best.speeds.items():
        console.print(f"{kind}: {forward:.2f} m/s ahead, {turning:.2f} rad/s", highlight=False)
    if write:
        write_found(opened, best)
    sentences = (
        f"sideways velocities are missed by {least[0]:.3f} m/s (<= {LIMITS[0]}; before {before[0]:.3f})",
        f"and by {least[1]:.3f} rad/s (<= {LIMITS[1]}; before {before[1]:.3f})",
    )
    verdicts = [
        Verdict(sentence, value <= limit) for sentence, value, limit in zip(sentences, least, LIMITS, strict=True)
    ]
    return Outcome(verdicts, {"corrections": best.model_dump(), "speed_error": least[0], "turning_error": least[1]})


def write_found(bundle: Bundle, corrections: Corrections) -> None:
    """Write corrections into a bundle's manifest."""
    sideways = {
        name: float(_rounded(np.array(getattr(corrections, name))))
        for name in ("aside", "ahead_per_aside", "turning_per_aside")
    }
    path: Path = bundle.folder / MANIFEST
    rounded = corrections.model_copy(update=sideways)
    write_manifest(bundle.manifest.model_copy(update={"corrections": rounded}), path)
