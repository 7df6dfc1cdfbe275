"""Does the model generate motion, or replay its training clips?

For each kind of motion among the held-out clips: samples of one prompt from standing, cut into the model's windows.
The distance of two windows is the root mean square over the body's points and the frames, in leg lengths, all on the
bundle's human, displacement and turning included. "nearest" is the mean distance to the nearest training window of any
kind, of samples and of held-out clips; "apart" is the mean distance between windows, of samples at the same moment and
of training clips. Fails where samples are less than .5 as far from the training windows as held-out clips are, or less
than .3 as far apart as training clips.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from rich.console import Console
from rich.progress import track
from rich.table import Table

from benchmarks.model.real_clips import kind_of, real_clips
from benchmarks.model.roll_out import always, roll_out
from benchmarks.model.window_distance import Float32, mean_distance, nearest_distance, windows_of
from benchmarks.shared.model import open_sampler
from benchmarks.shared.options import BundleArgument, CsvOption, PlotsOption, SetOption, StepsOption
from benchmarks.shared.outcome import Outcome, Verdict, write_csv
from flexmotion.configs.errors import ConfigError
from flexmotion.dataset.compact_set import MotionSet, open_set
from flexmotion.evaluation.interval import Interval
from flexmotion.sampling.sampler import Sampler
from flexmotion.text.phrases import wordings

NEAREST, APART = 0.5, 0.3
FEWEST = 20
"""Held-out windows that a kind must have to be judged."""

PAIRED = 200
"""Training windows of a kind whose distances are measured."""


@dataclass(frozen=True)
class Row:
    """One kind of motion; distances in leg lengths.

    Attributes:
        kind, prompt: of motion, and the wording that asked for it.
        sampled, held_out: distances to the nearest training window.
        samples_apart, clips_apart: mean distance between samples, between training windows of the kind.
    """

    kind: str
    prompt: str
    sampled: np.ndarray
    held_out: np.ndarray
    samples_apart: float
    clips_apart: float

    @property
    def nearest(self) -> float:
        """Distance of samples to the training windows, over that of held-out clips."""
        return float(self.sampled.mean() / self.held_out.mean())

    @property
    def apart(self) -> float:
        """Diversity of samples over that of training clips."""
        return self.samples_apart / self.clips_apart


def windows_by_kind(
    sampler: Sampler, found: MotionSet, split: str, stride: int, variant: str | None
) -> dict[str, Float32]:
    """Windows of a split's clips by kind of motion, of the bundle's human."""
    parts: dict[str, list[Float32]] = defaultdict(list)
    clips = list(found.select(split, variant))
    clips_of = real_clips(found, split, sampler.fps, variant=variant)
    for clip, motion in track(clips_of, split, total=len(clips), console=Console(stderr=True)):
        if len(motion) >= sampler.future:
            parts[kind_of(clip)].append(windows_of(motion, sampler.body, sampler.future, stride))
    return {kind: np.concatenate(rows) for kind, rows in parts.items()}


def sampled(sampler: Sampler, prompt: str, samples: int, seconds: float) -> Float32:
    """Windows of samples of a prompt, but the first, which begins in the same pose, (samples, windows, D)."""
    motions = [roll_out(sampler, always(prompt), seconds, seed).motion for seed in range(samples)]
    rows = [windows_of(motion, sampler.body, sampler.future, sampler.future) for motion in motions]
    return np.stack(rows)[:, 1:]


def judge_kind(
    sampler: Sampler,
    kind: str,
    held_out: Float32,
    training: Mapping[str, Float32],
    among: Float32,
    samples: int,
    seconds: float,
) -> Row:
    """One kind of motion."""
    prompt = wordings(kind)[0]
    made = sampled(sampler, prompt, samples, seconds)
    rng = np.random.default_rng(0)
    own = training[kind]
    return Row(
        kind,
        prompt,
        nearest_distance(made.reshape(-1, made.shape[-1]), among),
        nearest_distance(held_out, among),
        float(np.mean([mean_distance(made[:, place]) for place in range(made.shape[1])])),
        mean_distance(own[rng.permutation(len(own))[:PAIRED]]),
    )


def table(rows: Sequence[Row]) -> Table:
    """Kinds and their distances."""
    out = Table(title="Distances in leg lengths")
    columns = "samples nearest", "held-out nearest", "ratio", "samples apart", "clips apart", "ratio"
    for name in ("kind", "prompt", *columns):
        out.add_column(name, justify="left" if name in ("kind", "prompt") else "right")
    for row in rows:
        out.add_row(
            row.kind,
            row.prompt,
            str(Interval.of(row.sampled)),
            str(Interval.of(row.held_out)),
            f"{row.nearest:.2f}",
            f"{row.samples_apart:.3f}",
            f"{row.clips_apart:.3f}",
            f"{row.apart:.2f}",
        )
    return out


def draw(rows: Sequence[Row], path: Path) -> None:
    """Distances to the nearest training window by kind, of samples and of held-out clips."""
    from flexmotion.streamer.plots.palette import LEFT, MUTED
    from flexmotion.streamer.plots.style import new_figure, save, styled

    with styled():
        figure = new_figure(
            11, 4.0, "Memorisation", "distance to the nearest training window: samples blue, held-out grey"
        )
        axes = figure.subplots()
        for place, row in enumerate(rows):
            for offset, values, colour in ((-0.18, row.held_out, MUTED), (0.18, row.sampled, LEFT)):
                parts = axes.violinplot(values, [place + offset], widths=0.34, showextrema=False, showmedians=True)
                for body in parts["bodies"]:  # type: ignore[attr-defined]
                    body.set(facecolor=colour, alpha=0.6)
                parts["cmedians"].set_color(colour)
        axes.set_xticks(range(len(rows)), [row.kind for row in rows], rotation=30, ha="right")
        axes.set(ylabel="leg lengths", ylim=(0, None))
        save(figure, path)


def main(
    data: SetOption,
    bundle: BundleArgument = None,
    samples: Annotated[int, typer.Option(min=2, help="Of each prompt.")] = 20,
    seconds: Annotated[float, typer.Option(min=2.5, help="Length of a sample [s].")] = 4.0,
    stride: Annotated[int, typer.Option(min=1, help="Frames from one training window to the next.")] = 4,
    steps: StepsOption = None,
    csv_out: CsvOption = None,
    plots: PlotsOption = None,
) -> Outcome:
    """Compare samples with the nearest training windows, and with one another."""
    sampler, found = open_sampler(bundle, steps), open_set(data)
    length = sampler.future
    training = windows_by_kind(sampler, found, "train", stride, None)
    among = np.concatenate(list(training.values()))
    held_out = windows_by_kind(sampler, found, "validation", length, "original")
    kinds = [kind for kind, own in held_out.items() if len(own) >= FEWEST and kind in training and wordings(kind)]
    if not kinds:
        raise ConfigError(f"{data}: no kind of motion has {FEWEST} held-out windows")
    rows = [
        judge_kind(sampler, kind, held_out[kind], training, among, samples, seconds)
        for kind in track(sorted(kinds), "samples", console=Console(stderr=True))
    ]
    console = Console(width=160)
    console.print(table(rows))
    console.print(f"{len(among)} training windows of {length} frames at {sampler.fps:g} fps")
    if csv_out is not None:
        write_csv(csv_out, [csv_row(row) for row in rows])
    if plots is not None:
        plots.mkdir(parents=True, exist_ok=True)
        draw(rows, plots / "memorisation.png")
    # Each kind has the same weight, however many windows it has.
    near = float(np.mean([row.sampled.mean() for row in rows]) / np.mean([row.held_out.mean() for row in rows]))
    apart = float(np.mean([row.samples_apart for row in rows]) / np.mean([row.clips_apart for row in rows]))
    verdicts = [
        Verdict(f"distance to training windows, of samples over held-out: {near:.2f} (>= {NEAREST})", near >= NEAREST),
        Verdict(f"diversity, of samples over training clips: {apart:.2f} (>= {APART})", apart >= APART),
    ]
    return Outcome(verdicts, {"nearest": near, "apart": apart} | {row.kind: csv_row(row) for row in rows})


def csv_row(row: Row) -> dict[str, str | float]:
    """One kind's figures."""
    return {
        "kind": row.kind,
        "prompt": row.prompt,
        "samples_nearest": float(row.sampled.mean()),
        "held_out_nearest": float(row.held_out.mean()),
        "samples_apart": row.samples_apart,
        "clips_apart": row.clips_apart,
    }
