"""Does the model make motion, or play back its training clips?

    python benchmarks/jukebox.py BUNDLE --set SET [--samples 20] [--seconds 4] [--csv FILE] [--plots DIR]

Kind by kind of motion that held-out clips show: samples of one prompt from standing, cut into windows as the model
makes them. Distance of windows is the root mean square over the points of the body and the frames, in leg lengths,
all on the bundle's human, travel and turning included. "nearest" is the mean distance to the nearest training window of
any kind, of samples and of held-out clips; "apart" the mean distance between windows, of samples at the same moment and
of training clips. Exits with 1 where samples are less than .5 as far from the training windows as held-out clips are,
or less than .3 as far apart as training clips.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from model_rollout import always, roll_out
from real_clips import kind_of, real_clips
from rich.console import Console
from rich.progress import track
from rich.table import Table
from verdicts import Verdict, benchmark, write_csv
from window_distance import Float32, mean_distance, nearest_distance, windows_of

from flexmotion.bundles.bundle import Bundle
from flexmotion.configs.errors import ConfigError
from flexmotion.dataset.compact_set import MotionSet, open_set
from flexmotion.evaluation.interval import Interval
from flexmotion.sampling.sampler import Sampler
from flexmotion.text.phrases import wordings

NEAREST, APART = 0.5, 0.3
FEWEST = 20
"""Held-out windows from which on a kind is judged."""

PAIRED = 200
"""Training windows of a kind whose distances are taken."""


@dataclass(frozen=True)
class Row:
    """One kind of motion; distances in leg lengths.

    Attributes:
        kind, prompt: what was asked for, and how.
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
    """Windows of a split's clips by what they show, of the bundle's human."""
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
    out = Table(title="Jukebox: distances in leg lengths")
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
        figure = new_figure(11, 4.0, "Jukebox", "distance to the nearest training window: samples blue, held-out grey")
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
    folder: Annotated[Path, typer.Argument(metavar="BUNDLE", help="Bundle to judge.")],
    data: Annotated[Path, typer.Option("--set", help="Training set with held-out clips.")],
    samples: Annotated[int, typer.Option(min=2, help="Of each prompt.")] = 20,
    seconds: Annotated[float, typer.Option(min=2.5, help="Of each sample.")] = 4.0,
    stride: Annotated[int, typer.Option(min=1, help="Frames from one training window to the next.")] = 4,
    steps: Annotated[int | None, typer.Option(help="Of the diffusion; the bundle's own by default.")] = None,
    csv_out: Annotated[Path | None, typer.Option("--csv", help="Write one row a kind here.")] = None,
    plots: Annotated[Path | None, typer.Option(help="Folder for pictures.")] = None,
) -> list[Verdict]:
    """Compare samples with the training windows that they are nearest to, and with one another."""
    sampler, found = Sampler(Bundle(folder), steps), open_set(data)
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
        draw(rows, plots / "jukebox.png")
    # Kinds count alike, however many windows they have.
    near = float(np.mean([row.sampled.mean() for row in rows]) / np.mean([row.held_out.mean() for row in rows]))
    apart = float(np.mean([row.samples_apart for row in rows]) / np.mean([row.clips_apart for row in rows]))
    return [
        Verdict(f"distance to training windows, of samples over held-out: {near:.2f} (>= {NEAREST})", near >= NEAREST),
        Verdict(f"diversity, of samples over training clips: {apart:.2f} (>= {APART})", apart >= APART),
    ]


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


if __name__ == "__main__":
    benchmark(main)
