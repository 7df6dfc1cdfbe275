"""Does the model move as people do: trunk, wrists, elbows, steps, and the time that they stay in the pose?

Of every kind with enough recorded clips in the normal manner, those clips are parted at random into two halves. The
Wasserstein distance between the halves is what people differ by; then the model takes the place of one half: each of
its clips is sampled anew from its first frames, for as long. Both are means over those of forty partings that have
enough values of a figure: with two, real clips in place of samples failed in 6 of 31 kinds of trunk pitch, by chance in
3 to 10. A clip of a pose begins and ends with hanging arms, but a pose that is asked for is held until something else
is asked. Clips and samples of poses are compared from the first to the last frame in the pose, clips of repeated
strokes from their first stroke to their last, of turns from the first to the last step that turns.
Left clips are mirrored to the right. Fails where a figure of a kind is further from the recorded half than `LIMIT`
times the halves from each other, or where samples of a kind skate 1.2 times as much as its clips (of those that skate
in 5 % of the frames or more) or jerk 1.5 times as much. With `--plots` film strips and the distributions of each kind
are drawn.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from numpy.typing import NDArray
from rich.console import Console
from rich.progress import track
from rich.table import Table
from scipy.stats import wasserstein_distance

from benchmarks.model.motion_pictures import Strip, draw_strip
from benchmarks.model.posture_figures import FIGURES, figures, in_pose, on_body
from benchmarks.model.real_clips import kind_of, real_clips
from benchmarks.model.speeds import TURNS
from benchmarks.shared.model import open_sampler
from benchmarks.shared.options import BundleArgument, CsvOption, PlotsOption, SetOption, StepsOption
from benchmarks.shared.outcome import Outcome, Verdict, write_csv
from benchmarks.shared.poses import Mask
from benchmarks.shared.prompts import gesture_kinds, prompt_kinds
from flexmotion.biomechanics.mirror import mirror
from flexmotion.bundles.repertoire import offered_kinds
from flexmotion.dataset.compact_set import MotionSet, open_set
from flexmotion.dataset.meaning import shown
from flexmotion.evaluation.motions import foot_metrics, jerk
from flexmotion.human.motion import Motion
from flexmotion.sampling.course import MEASURED_S
from flexmotion.sampling.rhythm import rhythm_kinds
from flexmotion.sampling.sampler import Sampler
from flexmotion.spatial.heading import continuous_heading
from flexmotion.streamer.motion.intents import Text
from flexmotion.streamer.motion.model_source import ModelSource
from flexmotion.streamer.motion.targets import Target
from flexmotion.streamer.plots.palette import INK, MUTED, RIGHT
from flexmotion.streamer.plots.style import new_figure, save, styled
from flexmotion.text.manners import NORMAL
from flexmotion.text.phrases import wordings
from flexmotion.text.sides import mirrored, sides

Float = NDArray[np.float64]

LIMIT = 1.3
"""Greatest distance of samples from recorded clips, over that of recorded clips from each other."""
FEWEST, MOST = 8, 12
"""Clips of a kind without which there are no halves to compare; most clips of a half."""
SKATE_LIMIT, JERK_LIMIT = 1.2, 1.5
"""Greatest skate and jerk of samples, over those of clips of the same kind."""
SKATES = 0.05
"""Clips of a kind that skate in fewer of their frames are no measure of it."""
SHORTEST_S, LONGEST_S = 0.5, 8.0
"""Shortest clip; of a longer one, the first part of this length is compared [s]."""
REACHED_S = 1.5
"""Time in which a sample reaches the pose that is asked for [s]."""
PARTINGS = 40
"""Of the clips into halves; the same samples take part in all."""
EVENTS = 12
"""Fewest values of a figure in each half. A parting with fewer does not count, and a figure that none counts for is not
compared: a standing human makes hardly a step."""


@dataclass
class Compared:
    """A kind of motion, or a pair of mirror images.

    Attributes:
        kind: its name.
        clips: how many recorded clips there are.
        real, made: distance of a recorded and of a sampled half from the other half, by figure.
        partings: how many count, by figure: those with `EVENTS` values in each half.
        values: of the recorded half, of the other one, and of the sampled one, by figure, of the last of them.
        strips: a recorded clip, and the sample in its place.
        skates, jerks: share of frames in which a low foot slides, and mean jerk [m/s³], of clips and of samples.
    """

    kind: str
    clips: int
    real: dict[str, float]
    made: dict[str, float]
    partings: dict[str, int]
    values: dict[str, tuple[Float, Float, Float]]
    strips: tuple[Motion, Motion]
    skates: tuple[float, float] = (0.0, 0.0)
    jerks: tuple[float, float] = (0.0, 0.0)

    def ratio(self, name: str) -> float:
        """Of the distances of a figure; distances below the least that counts are taken as that."""
        least = FIGURES[name][1]
        return max(self.made[name], least) / max(self.real[name], least)


def normal_clips(found: MotionSet, sampler: Sampler) -> dict[str, list[Motion]]:
    """Recorded clips in the normal manner by kind, on the sampler's body; left ones are mirrored to the right."""
    clips, most = defaultdict(list), round(LONGEST_S * sampler.fps)
    every = (each for split in ("train", "validation") for each in real_clips(found, split, sampler.fps))
    for clip, motion in every:
        if clip.info["labels"].get("style") == NORMAL:
            kind, own = kind_of(clip), on_body(motion, sampler.body)[:most]
            if sides(kind) == {"left"}:
                kind, own = mirrored(kind), mirror(own)
            if kind in rhythm_kinds() and (part := shown(clip.info["labels"])) is not None:
                # Clips end, and a sample claps on: the strokes alone are compared, after the same frames before them.
                first, last = (
                    round(part.start * sampler.fps) - sampler.remembers,
                    round((part.left or part.end) * sampler.fps),
                )
                own = own[max(first, 0) : max(last, 0)]
            if turns(sampler, kind):
                # Clips lead up to a turn and away from it, and a sample turns from its first step to its last.
                own = turning_part(own, sampler.remembers)
            long = len(own) >= sampler.remembers + SHORTEST_S * sampler.fps
            if long and is_in_pose(own[sampler.remembers :], checks(kind)):
                clips[kind].append(own)
    return clips


def turns(sampler: Sampler, kind: str) -> bool:
    """Whether a kind of motion is one that turns all the time."""
    speed = sampler.bundle.manifest.corrections.speed(kind, NORMAL)
    return speed is not None and bool(speed[2])


def turning_part(motion: Motion, before: int) -> Motion:
    """A motion from the first to the last frame in which it turns, and so many frames before them, where it has them.

    A frame's turning is the mean over the gait cycle around it, as that of `model/speeds`.
    """
    cycle = round(MEASURED_S * motion.fps)
    headings = continuous_heading(motion.root_quaternion)
    rate = (headings[cycle:] - headings[:-cycle]) / MEASURED_S
    frames = np.flatnonzero(np.abs(rate) > TURNS) + cycle // 2
    return motion[max(int(frames[0]) - before, 0) : int(frames[-1]) + 1] if len(frames) else motion[:0]


def checks(kind: str) -> Mapping[str, Any]:
    """What the judge of a kind asks for; empty where it has none."""
    return next((entry.check for entry in (*prompt_kinds(), *gesture_kinds()) if entry.of == kind), {})


@dataclass(frozen=True)
class Held:
    """The part of a motion that is compared, and its frames in the pose that is asked for, (T,); None without one."""

    motion: Motion
    pose: Mask | None


def held_part(motion: Motion, check: Mapping[str, Any]) -> Held:
    """A motion from the first to the last frame in the pose that is asked for; all of one that never is in it."""
    pose = in_pose(motion, check)
    if pose is None or not pose.any():
        return Held(motion, pose)
    frames = np.flatnonzero(pose)
    part = slice(int(frames[0]), int(frames[-1]) + 1)
    return Held(motion[part], pose[part])


def is_in_pose(motion: Motion, check: Mapping[str, Any]) -> bool:
    """Whether a motion is ever in the pose that is asked for, where one is.

    On the model's body a hand of somebody with wider shoulders misses the heart: no clip of a hand on the heart.
    """
    pose = in_pose(motion, check)
    return pose is None or bool(pose.any())


def streamed(sampler: Sampler, kind: str, begin: Motion, frames: int, seed: int) -> Motion:
    """The live source's motion after a history, as handed on."""
    source = ModelSource(sampler, [], "distributions", seed)
    source.turn_to(Target(1, 1, Text(wordings(kind)[0])), len(begin) - 1, begin)
    made = source.window(len(begin), frames)
    assert made is not None
    return made


def sampled(sampler: Sampler, kind: str, begin: Motion, recorded: Held, seed: int) -> Held:
    """What the model does in place of a clip: after its first frames, for as long as it is compared."""
    frames = len(recorded.motion)
    if recorded.pose is None:
        return Held(streamed(sampler, kind, begin, frames, seed), None)
    made = streamed(sampler, kind, begin, frames + round(REACHED_S * sampler.fps), seed)
    reached = in_pose(made, checks(kind))
    assert reached is not None
    first = min(int(np.argmax(reached)) if reached.any() else len(made), len(made) - frames)
    return Held(made[first : first + frames], reached[first : first + frames])


def measured(own: Held, kind: str) -> dict[str, Float]:
    """All values of every figure. A kind without a side counts with its mirror images, since no side was asked for."""
    each = [figures(own.motion, own.pose)]
    if not sides(kind):
        each.append(figures(mirror(own.motion), own.pose))
    return {name: np.concatenate([one[name] for one in each]) for name in FIGURES}


def compare(sampler: Sampler, kind: str, clips: Sequence[Motion], draws: int, seed: int) -> Compared:
    """Sample some clips anew, part the clips into halves, put the samples in the place of one, and measure.

    Args:
        sampler: of the model.
        kind: of the clips.
        clips: `FEWEST` or more.
        draws: halves of the clips that are sampled, at most all.
        seed: of the samples and of the partings.
    """
    began = sampler.remembers
    half = min(MOST, len(clips) // 2)
    random = np.random.default_rng([seed])
    drawn = random.permutation(len(clips))[: draws * half]
    recorded = [held_part(clip[began:], checks(kind)) for clip in clips]
    samples = {
        int(at): sampled(sampler, kind, clips[at][:began], recorded[at], seed + number)
        for number, at in enumerate(drawn)
    }
    of_clips = [measured(own, kind) for own in recorded]
    of_samples = {at: measured(own, kind) for at, own in samples.items()}
    found = parted(of_clips, of_samples, half, random)
    smooth = np.array([_smoothness(part) for part in ([recorded[at] for at in samples], list(samples.values()))])
    shown_clip = next(iter(samples))
    return Compared(
        kind,
        len(clips),
        real={name: own.real for name, own in found.items()},
        made={name: own.made for name, own in found.items()},
        partings={name: own.partings for name, own in found.items()},
        values={name: own.values for name, own in found.items()},
        strips=(recorded[shown_clip].motion, samples[shown_clip].motion),
        skates=_pair(smooth[:, 0]),
        jerks=_pair(smooth[:, 1]),
    )


@dataclass(frozen=True)
class Parted:
    """A figure of one kind over the partings of its clips that count.

    Attributes:
        real, made: mean distance of a recorded and of a sampled half from the other half.
        partings: how many count.
        values: of the recorded half, of the other one, and of the sampled one, of the last of them.
    """

    real: float
    made: float
    partings: int
    values: tuple[Float, Float, Float]


def parted(
    clips: Sequence[Mapping[str, Float]],
    samples: Mapping[int, Mapping[str, Float]],
    half: int,
    random: np.random.Generator,
) -> dict[str, Parted]:
    """Every figure that has a parting that counts, of `PARTINGS`.

    Args:
        clips: values of every figure.
        samples: likewise, of samples in the place of some of the clips, by the place of the clip.
        half: clips of each half.
        random: generator of the partings.
    """
    drawn = np.array(list(samples))
    far: dict[str, list[tuple[float, float]]] = defaultdict(list)
    values: dict[str, tuple[Float, Float, Float]] = {}
    for _ in range(PARTINGS):
        first = random.permutation(drawn)[:half]
        second = random.permutation(np.setdiff1d(np.arange(len(clips)), first))[:half]
        parts = [clips[at] for at in first], [clips[at] for at in second], [samples[at] for at in first]
        for name in clips[0]:
            one, other, made = (np.concatenate([own[name] for own in part]) for part in parts)
            if min(map(len, (one, other, made))) >= (1 if name == "time in pose" else EVENTS):
                real, own = (float(wasserstein_distance(each, other)) for each in (one, made))
                far[name].append((real, own))
                values[name] = one, other, made
    means = {name: _pair(np.mean(each, axis=0)) for name, each in far.items()}
    return {name: Parted(*mean, len(far[name]), values[name]) for name, mean in means.items()}


def _smoothness(part: Sequence[Held]) -> tuple[float, float]:
    """Mean skate and jerk of motions."""
    found = [(foot_metrics(own.motion)["skate_ratio"], float(jerk(own.motion).mean())) for own in part]
    skates, jerks = np.mean(found, axis=0)
    return float(skates), float(jerks)


def _pair(values: Float) -> tuple[float, float]:
    clips, samples = values.tolist()
    return clips, samples


def table(rows: Sequence[Compared]) -> Table:
    """One kind a line: the distance of samples from clips, that of clips from each other."""
    made = Table("kind", "clips", *(f"{name} {unit}" for name, (unit, _) in FIGURES.items()), title="Samples / clips")
    for row in rows:
        cells = []
        for name in FIGURES:
            far = "" if name not in row.real else f"{row.made[name]:.1f} / {row.real[name]:.1f}{_fewer(row, name)}"
            cells.append(f"[bold]{far}[/bold]" if far and row.ratio(name) > LIMIT else far)
        made.add_row(row.kind, str(row.clips), *cells)
    return made


def _fewer(row: Compared, name: str) -> str:
    """How many partings of a figure count, where they are not all, in words."""
    return "" if row.partings[name] == PARTINGS else f" ({row.partings[name]} of {PARTINGS} partings)"


def draw(row: Compared, plots: Path) -> Path:
    """Film strips of a clip and of the sample in its place; below them the distributions of every figure."""
    names = list(row.values)
    figure = new_figure(
        12,
        7.2,
        f"{row.kind}: recorded and sampled",
        "film strips: a clip, and a sample after its first frames; curves: share of values up to there, "
        "two halves of the recorded clips (grey), samples (orange)",
    )
    parts: Any = figure.subfigures(2, 1, height_ratios=[1.5, 1])
    top, bottom = parts
    for axes, title, motion in zip(top.subplots(2, 1), ("recorded", "sampled"), row.strips, strict=True):
        draw_strip(axes, Strip(title, motion))
    for axes, name in zip(np.atleast_1d(bottom.subplots(1, len(names))), names, strict=True):
        for values, colour in zip(row.values[name], (MUTED, INK, RIGHT), strict=True):
            axes.plot(np.sort(values), np.linspace(0.0, 1.0, len(values)), color=colour)
        axes.set(title=f"{name} [{FIGURES[name][0]}], {row.ratio(name):.1f} x", ylim=(0, 1), yticks=(0, 0.5, 1))
    return save(figure, plots / f"distributions_{row.kind}.png")


def main(
    data: SetOption,
    bundle: BundleArgument = None,
    draws: Annotated[int, typer.Option(min=1, help="Halves of the clips that are sampled.")] = 4,
    seed: Annotated[int, typer.Option(min=0, help="Of the partings and of the samples.")] = 0,
    kind: Annotated[list[str] | None, typer.Option(help="Kind of motion; may be given again.")] = None,
    steps: StepsOption = None,
    plots: PlotsOption = None,
    csv_out: CsvOption = None,
) -> Outcome:
    """Compare samples with recorded clips, and those with each other."""
    sampler = open_sampler(bundle, steps)
    clips = normal_clips(open_set(data), sampler)
    offered = [own for own in offered_kinds(sampler.bundle) if sides(own) != {"left"} and own != "stand"]
    asked = [own for own in offered if kind is None or own in kind]
    few = [own for own in asked if len(clips[own]) < FEWEST]
    rows = [
        compare(sampler, own, clips[own], draws, seed)
        for own in track(asked, "kinds", console=Console(stderr=True))
        if own not in few
    ]
    Console(width=160).print(table(rows))
    if few:
        typer.echo(f"fewer than {FEWEST} recorded clips in the normal manner: {', '.join(few)}")
    if plots is not None:
        plots.mkdir(parents=True, exist_ok=True)
        with styled():
            for row in rows:
                typer.echo(draw(row, plots))
    flat = [{"kind": row.kind, "figure": name, **_figure(row, name)} for row in rows for name in row.real]
    if csv_out is not None:
        write_csv(csv_out, flat)
    return Outcome(verdicts(rows), {"by_kind": {row.kind: _told(row) for row in rows}, "few": few})


def verdicts(rows: Sequence[Compared]) -> list[Verdict]:
    """One of every figure: in how many kinds samples are as near to clips as clips to each other."""
    found = []
    for name in FIGURES:
        ratios = {row.kind: row.ratio(name) for row in rows if name in row.real}
        if ratios:
            near, worst = sum(ratio <= LIMIT for ratio in ratios.values()), max(ratios, key=lambda kind: ratios[kind])
            told = (
                f"{name}: {near} of {len(ratios)} kinds within {LIMIT} x, median {np.median(list(ratios.values())):.2f}"
            )
            fewer = [f"{row.kind}{_fewer(row, name)}" for row in rows if name in row.real and _fewer(row, name)]
            rest = f"; too few values in the others: {', '.join(fewer)}" if fewer else ""
            found.append(Verdict(f"{told}, worst {worst} {ratios[worst]:.1f}{rest}", near == len(ratios)))
    skates = {row.kind: row.skates for row in rows if row.skates[0] >= SKATES}
    jerks = {row.kind: row.jerks for row in rows if row.jerks[0] > 0.0}
    for name, pairs, limit in (("skate", skates, SKATE_LIMIT), ("jerk", jerks, JERK_LIMIT)):
        if pairs:
            over = {kind: samples / clips for kind, (clips, samples) in pairs.items()}
            near, worst = sum(own <= limit for own in over.values()), max(over, key=lambda kind: over[kind])
            told = f"{name}: {near} of {len(over)} kinds within {limit} x that of clips"
            found.append(Verdict(f"{told}, worst {worst} {over[worst]:.2f}", near == len(over)))
    return found


def _figure(row: Compared, name: str) -> dict[str, float]:
    """A figure of a kind, for the result and for `--csv`."""
    own = {"samples": row.made[name], "clips": row.real[name], "ratio": row.ratio(name)}
    return own | {"partings": row.partings[name]}


def _told(row: Compared) -> dict[str, Any]:
    smooth = {"skate": row.skates, "jerk": row.jerks}
    told = {name: _figure(row, name) for name in row.real}
    return told | {name: {"samples": samples, "clips": clips} for name, (clips, samples) in smooth.items()}
