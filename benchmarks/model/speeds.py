"""How fast do people do a kind of motion, by manner, and does the model go as fast by words alone?

`speeds` of a bundle is the median velocity of recorded clips of a kind in the normal manner, or in any manner where
those are few; `manner_speeds` that of clips in another manner. A kind that turns counts where it turns. `--write` puts
both into the bundle, whatever the verdict. Judged are samples from standing after they sped up, at the found speeds:
fails where they are off by more than .15 m/s or .2 rad/s in the mean over kinds and the manners that the bundle offers.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from numpy.typing import NDArray
from rich.console import Console
from rich.progress import track
from rich.table import Table

from benchmarks.model.corrections import on_grid
from benchmarks.model.posture_figures import on_body
from benchmarks.shared.judges import frame_velocities
from benchmarks.shared.model import open_bundle
from benchmarks.shared.options import BundleArgument, SetOption, WriteOption
from benchmarks.shared.outcome import Outcome, Verdict
from benchmarks.shared.streamed import streamed
from flexmotion.bundles.bundle import Bundle
from flexmotion.bundles.manifest import MANIFEST, write_manifest
from flexmotion.bundles.repertoire import offered_manners
from flexmotion.configs.corrections import Corrections, Velocity
from flexmotion.configs.errors import ConfigError
from flexmotion.dataset.collections import only
from flexmotion.dataset.compact_set import MotionSet, open_set
from flexmotion.dataset.meaning import clip_kind, clip_manner
from flexmotion.human.body import Body
from flexmotion.human.resample import resample
from flexmotion.sampling.course import MEASURED_S
from flexmotion.sampling.sampler import Sampler
from flexmotion.text import phrases
from flexmotion.text.manners import NORMAL, styled
from flexmotion.text.sides import mirrored, sides

Float = NDArray[np.float64]
Moments = Mapping[tuple[str, str], Sequence[Float]]
"""Velocities of the clips of a kind in a manner, each (K, 3)."""

FEWEST = 3
"""Clips that tell a speed."""
TRAVELS, TURNS = 0.35, 0.2
"""A kind travels whose clips go ahead or back faster than this, and turns where they turn faster [m/s, rad/s]."""
LIMITS = 0.15, 0.2
BEGIN_S, JUDGED_S = 3.0, 6.0
"""Time in which a body speeds up, and time that is judged after it [s]."""


def spoken_kinds(bundle: Bundle) -> list[str]:
    """Kinds of motion of a bundle that are done with the legs, and whose words mean no velocity."""
    kinds = sorted(set(bundle.prompts.kinds))
    return [kind for kind in kinds if phrases.velocity(kind) is None and "leg" in (phrases.limbs(kind) or ())]


def moments(found: MotionSet, kinds: Sequence[str], body: Body, fps: float) -> Moments:
    """Means over a gait cycle of the velocities of training clips; those to the right are mirrored to the left."""
    velocities: dict[tuple[str, str], list[Float]] = defaultdict(list)
    cycle = round(MEASURED_S * fps)
    for clip in found.select("train", "original"):
        labels, captions = clip.info["labels"], [caption["text"] for caption in clip.info["captions"]]
        kind, manner = clip_kind(labels, captions), clip_manner(labels, captions)
        if kind not in kinds or manner is None:
            continue
        motion = on_body(resample(replace(found.motion(clip), activations=None), fps), body)
        if len(motion) <= cycle:
            continue
        sums = np.cumsum(frame_velocities(motion), axis=0)
        own = (sums[cycle - 1 :] - np.concatenate([np.zeros((1, 3)), sums[:-cycle]])) / cycle
        if sides(kind) == {"right"}:
            kind, own = mirrored(kind), own * [1.0, -1.0, -1.0]
        velocities[kind, manner].append(own)
    return velocities


def speed(clips: Sequence[Float], kind: str) -> Velocity | None:
    """Median velocity of clips, (K, 3) each; None where they are few or do not travel."""
    if len(clips) < FEWEST:
        return None
    every = np.concatenate(clips)
    if sides(kind):
        every = every[every[:, 2] > TURNS]
    forward, _, turning = np.median(every, axis=0) if len(every) else np.zeros(3)
    if abs(forward) <= TRAVELS:
        return None
    # Words that mean sideways motion mean a velocity: what else goes aside is sway.
    return on_grid(forward), 0.0, on_grid(turning) if sides(kind) else 0.0


def speeds(of_clips: Moments, manners: Sequence[str]) -> tuple[dict[str, Velocity], dict[str, dict[str, Velocity]]]:
    """Speeds by kind, and by manner and kind where a manner has another one; both sides of a kind are mirror images."""
    normal: dict[str, Velocity] = {}
    by_manner: dict[str, dict[str, Velocity]] = defaultdict(dict)
    for kind in sorted({kind for kind, _ in of_clips}):
        every = [clip for (own, _), clips in of_clips.items() if own == kind for clip in clips]
        usual = speed(of_clips.get((kind, NORMAL), ()), kind) or speed(every, kind)
        if usual is None:
            continue
        normal |= _both_sides(kind, usual)
        for manner in manners:
            own = speed(of_clips.get((kind, manner), ()), kind)
            if manner != NORMAL and own is not None and own != usual:
                by_manner[manner] |= _both_sides(kind, own)
    return normal, dict(by_manner)


def _both_sides(kind: str, velocity: Velocity) -> dict[str, Velocity]:
    """The velocity of a kind and of its mirror image."""
    forward, _, turning = velocity
    return {kind: velocity} | ({mirrored(kind): (forward, 0.0, -turning)} if sides(kind) else {})


def made(sampler: Sampler, text: str, samples: int) -> Float:
    """Mean velocities of samples by a text, as they are streamed, (samples, 3)."""
    motions = [streamed(sampler, text, BEGIN_S + JUDGED_S, seed) for seed in range(samples)]
    begun = round(BEGIN_S * sampler.fps)
    return np.array([frame_velocities(motion)[begun:].mean(axis=0) for motion in motions])


def main(
    data: SetOption,
    bundle: BundleArgument = None,
    samples: Annotated[int, typer.Option(min=1, help="Of each kind and manner.")] = 4,
    of: Annotated[str, typer.Option("--only", help="Clips of these collections alone, as `train --only`.")] = "",
    write: WriteOption = False,
) -> Outcome:
    """Measure the speeds of clips, and those of samples by them."""
    opened = open_bundle(bundle)
    if not opened.manifest.velocity:
        raise ConfigError(f"{opened.folder}: this bundle does not follow velocities")
    of_clips = moments(only(open_set(data), of.split(",")), spoken_kinds(opened), opened.body, opened.layout.fps)
    manners = opened.manners.names
    normal, by_manner = speeds(of_clips, manners)
    best = opened.manifest.corrections.model_copy(update={"speeds": normal, "manner_speeds": by_manner})
    opened.manifest = opened.manifest.model_copy(update={"corrections": best})
    sampler = Sampler(opened, unjudged=True)
    table = Table("kind", "manner", "clips m/s, rad/s", "samples", "sd of samples")
    off, rows, offered = [], {}, offered_manners(opened)
    asked = [(kind, manner) for kind in normal for manner in (NORMAL, *by_manner) if _is_known(best, kind, manner)]
    for kind, manner in track(asked, "samples", console=Console(stderr=True)):
        wanted = best.speed(kind, manner)
        assert wanted is not None
        found = made(sampler, styled(phrases.wordings(kind)[0], manner)[0], samples)[:, [0, 2]]
        mean, spread, goal = found.mean(axis=0), found.std(axis=0), np.array(wanted)[[0, 2]]
        if manner in offered:
            off.append(np.abs(mean - goal))
        rows[f"{kind}, {manner}"] = {"clips": goal.tolist(), "samples": mean.tolist()}
        shown = manner if manner in offered else f"{manner}, not offered"
        table.add_row(kind, shown, *(f"{one[0]:.2f}, {one[1]:.2f}" for one in (goal, mean, spread)))
    console = Console(width=120)
    console.print(table)
    if write:
        path: Path = opened.folder / MANIFEST
        write_manifest(opened.manifest, path)
    told = zip(np.mean(off, axis=0) if off else np.zeros(2), LIMITS, ("m/s", "rad/s"), strict=True)
    verdicts = [Verdict(f"samples off by {mean:.2f} {unit} (<= {limit})", mean <= limit) for mean, limit, unit in told]
    return Outcome(verdicts, {"of": rows})


def _is_known(corrections: Corrections, kind: str, manner: str) -> bool:
    """Whether the speed of a kind is one of its own in a manner."""
    return manner == NORMAL or kind in corrections.manner_speeds[manner]
