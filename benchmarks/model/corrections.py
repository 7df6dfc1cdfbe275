"""Which corrections does a bundle need, so that it moves as it is asked to?

They are fitted to samples from standing, by a few rounds over velocities: what is asked for changes by a share of what
the samples lack; the round with the least error is kept, and judged on other samples. First forward velocities and
turning, then the gain of sideways ones and the forward velocity and turning that come with them. The other corrections
stay as they are. `--write` puts the found ones into the bundle, whatever the verdict. Fails where velocities are missed
by more than .15 m/s or .2 rad/s in the mean.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
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

Float = NDArray[np.float64]

SPEEDS = (-0.7, -0.3, 0.15, 0.3, 0.5, 0.8, 1.1)
"""Forward velocities at which `ahead` is fitted, besides 0 [m/s]."""
TURNING: tuple[Velocity, ...] = tuple((ahead, 0.0, turn) for ahead in (0.0, 0.5) for turn in (-0.6, 0.6))
"""Velocities by which turning is fitted, and `ahead` at 0."""
AHEAD: tuple[Velocity, ...] = tuple((speed, 0.0, 0.0) for speed in SPEEDS) + TURNING
SIDEWAYS: tuple[Velocity, ...] = tuple((0.0, side * aside, 0.0) for aside in (0.15, 0.22, 0.3) for side in (-1, 1))
"""Velocities by which corrections are fitted [m/s, m/s, rad/s]."""
ROUNDS, STEP = 5, 0.7
"""Rounds of each fit, and the share of what is missing that a round adds."""
MOST_GAIN, MOST_SHIFT = 3.0, 0.8
"""Bounds: of a gain; of how far the velocity that is asked for is from the wanted one [m/s]."""
LIMITS = 0.15, 0.2
SETTLE_S = 1.0
"""Time in which a body speeds up [s]."""
GRID = 0.05
"""Corrections are rounded to this: samples do not tell them more finely."""

Improve = Callable[[Corrections, Float], Corrections]


def sampler_with(bundle: Bundle, corrections: Corrections) -> Sampler:
    """A sampler of a bundle, of all kinds that it knows, with other corrections."""
    bundle.manifest = bundle.manifest.model_copy(update={"corrections": corrections})
    return Sampler(bundle, unjudged=True)


def settled(sampler: Sampler, velocity: Velocity, seconds: float, seed: int) -> Float:
    """Mean velocity of a sample after the first second: forward, left [m/s], turning left [rad/s]."""
    motion = roll_out(sampler, always(velocity=velocity), SETTLE_S + seconds, seed).motion
    found: Float = frame_velocities(motion)[-round(seconds * sampler.fps) :].mean(axis=0)
    return found


def responses(sampler: Sampler, asked: Sequence[Velocity], seeds: range, seconds: float) -> Float:
    """Mean velocities of the samples of each asked one, (K, 3)."""
    return np.array(
        [np.mean([settled(sampler, velocity, seconds, seed) for seed in seeds], axis=0) for velocity in asked]
    )


def errors(asked: Sequence[Velocity], found: Float) -> tuple[float, float]:
    """Mean error of responses: speed [m/s] and turning [rad/s]."""
    apart = found - np.array(asked)
    return float(np.hypot(apart[:, 0], apart[:, 1]).mean()), float(np.abs(apart[:, 2]).mean())


def improved_ahead(corrections: Corrections, found: Float) -> Corrections:
    """Corrections of forward velocities and turning after one round, by the responses to `AHEAD`."""
    asked, turned = np.array(TURNING), found[len(SPEEDS) :]
    gain = float(np.clip((turned[:, 2] / asked[:, 2]).mean(), 1 / MOST_GAIN, MOST_GAIN))
    on_the_spot = float(turned[asked[:, 0] == 0.0, 0].mean())
    lacks = {0.0: -on_the_spot} | {speed: speed - row[0] for speed, row in zip(SPEEDS, found, strict=False)}
    ahead = []
    for speed, lack in sorted(lacks.items()):
        shift = corrections.asked_ahead(speed) - speed + STEP * float(lack)
        # Never the other way than wanted: backward samples go at one speed, and would be asked to go ahead.
        least, most = (-MOST_SHIFT if speed <= 0 else -speed), (MOST_SHIFT if speed >= 0 else -speed)
        ahead.append((speed, speed + min(max(shift, least), most)))
    return corrections.model_copy(
        update={
            "ahead": tuple(ahead),
            "turning": min(corrections.turning * gain**-STEP, MOST_GAIN),
        }
    )


def improved_aside(corrections: Corrections, found: Float) -> Corrections:
    """Sideways corrections after one round, by the responses to `SIDEWAYS`."""
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


def fit(
    name: str,
    bundle: Bundle,
    start: Corrections,
    asked: Sequence[Velocity],
    improve: Improve,
    samples: int,
    seconds: float,
) -> tuple[Corrections, list[tuple[float, float]]]:
    """The best corrections of some rounds, and the errors of every round."""
    best, tried, found_errors = start, start, []
    for _ in track(range(ROUNDS), name, console=Console(stderr=True)):
        found = responses(sampler_with(bundle, tried), asked, range(samples), seconds)
        found_errors.append(errors(asked, found))
        if sum(found_errors[-1]) == min(map(sum, found_errors)):
            best = tried
        tried = rounded(improve(tried, found))
    return best, found_errors


def rounded(corrections: Corrections) -> Corrections:
    """Corrections as finely as samples tell them."""
    gains = ("turning", "aside", "ahead_per_aside", "turning_per_aside")
    ahead = tuple((speed, on_grid(asked)) for speed, asked in corrections.ahead)
    return corrections.model_copy(
        update={**{name: on_grid(getattr(corrections, name)) for name in gains}, "ahead": ahead}
    )


def on_grid(value: float) -> float:
    """A velocity or gain as finely as samples and clips tell it."""
    return round(round(value / GRID) * GRID, 3)


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
    best, verdicts, figures, table = opened.manifest.corrections, [], {}, Table("velocities", "errors by round")
    for name, asked, improve in (("forward", AHEAD, improved_ahead), ("sideways", SIDEWAYS, improved_aside)):
        best, found = fit(name, opened, best, asked, improve, samples, seconds)
        table.add_row(name, ", ".join(f"{speed:.2f} m/s {turning:.2f} rad/s" for speed, turning in found))
        judged = responses(sampler_with(opened, best), asked, range(samples, 2 * samples), seconds)
        least, told = errors(asked, judged), found[0]
        for place, unit in enumerate(("m/s", "rad/s")):
            sentence = f"{name}: missed by {least[place]:.3f} {unit} (<= {LIMITS[place]}; before {told[place]:.3f})"
            verdicts.append(Verdict(sentence, least[place] <= LIMITS[place]))
        figures[f"{name}_errors"] = list(least)
    console = Console(width=120)
    console.print(table)
    console.print_json(data=best.model_dump())
    if write:
        path: Path = opened.folder / MANIFEST
        write_manifest(opened.manifest.model_copy(update={"corrections": best}), path)
    return Outcome(verdicts, {"corrections": best.model_dump(), **figures})
