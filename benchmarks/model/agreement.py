"""Does a plan that is made again agree with the last one, where nothing new is asked for?

    python benchmarks/agreement.py BUNDLE [--samples 10] [--again 0.25] [--csv FILE] [--plots DIR]

From moments of roll-outs, a window is sampled, its first quarter of a second is played, and the next window is made
from there in three ways: with fresh noise, with the same noise, and as the live system does, which keeps what it has
said and adds to it (`flexmotion.streamer.motion.model_source`). Compared at 1 s of the old window: root, farther foot,
heading; "later" at 1 s of the new window, against the old one and the one that would have followed it. Exits with 1
where at 1 s, as the live system does it, the 90th percentile is more than 5 cm or 3 degrees.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from model_rollout import always, roll_out
from numpy.typing import NDArray
from rich.console import Console
from rich.progress import track
from rich.table import Table
from verdicts import Verdict, benchmark, write_csv

from flexmotion.bundles.bundle import Bundle
from flexmotion.human.concatenate import concatenate
from flexmotion.human.kinematics import forward
from flexmotion.human.motion import Motion
from flexmotion.sampling.sampler import Condition, Sampler
from flexmotion.spatial.heading import matrix_heading
from flexmotion.streamer.motion.intents import Text
from flexmotion.streamer.motion.model_source import ModelSource
from flexmotion.streamer.motion.script import Item

Float = NDArray[np.float64]

PROMPTS = {
    "standing": ("stand still",),
    "gestures": ("wave with the right hand", "raise the left hand", "bow"),
    "walking": ("walk forward", "walk backward", "run"),
    "turning": ("turn left", "turn right"),
}
LIMIT_M, LIMIT_DEG = 0.05, 3.0
LOOKAHEAD_S = 1.0
SETTLE_S, APART_S, MOMENTS = 1.0, 1.3, 3
"""A roll-out is looked at after so long, and then so often, at these intervals."""

WAYS = ("fresh noise", "same noise", "live system")


@dataclass(frozen=True)
class Trial:
    """How far two plans are from one another.

    Attributes:
        kind, way: what was asked for, and how it was planned again.
        root, foot: [m]; heading: [degrees]; at 1 s of the old plan.
        later: likewise, (3,), at 1 s of the new one.
    """

    kind: str
    way: str
    root: float
    foot: float
    heading: float
    later: Float


def apart(first: Motion, second: Motion, frame: int, other: int) -> Float:
    """Root [m], farther foot [m] and heading [degrees] between a frame of one motion and one of another."""
    one, two = forward(first[frame : frame + 1]), forward(second[other : other + 1])
    feet = np.stack([one.ankle - two.ankle, one.toe - two.toe])
    turn = matrix_heading(one.pelvis_rotation[0]) - matrix_heading(two.pelvis_rotation[0])
    return np.array(
        [
            np.linalg.norm(one.pelvis_position[0] - two.pelvis_position[0]),
            np.linalg.norm(feet, axis=-1).max(),
            abs(np.degrees(np.arctan2(np.sin(turn), np.cos(turn)))),
        ]
    )


def redrawn(sampler: Sampler, prompt: str, seed: int, again: int, same: bool) -> list[tuple[Float, Float]]:
    """Planned again by sampling; at 1 s of the old plan, and of the new one."""
    fps, condition = sampler.fps, Condition(prompt)
    ahead = round(LOOKAHEAD_S * fps)
    made = roll_out(sampler, always(prompt), SETTLE_S + MOMENTS * APART_S, seed).motion
    found = []
    for moment in range(MOMENTS):
        past = made[: round((SETTLE_S + moment * APART_S) * fps)]
        noise = 10 * (seed * MOMENTS + moment)
        old = sampler.sample(past, condition, noise)
        old = concatenate([old, sampler.sample(concatenate([past, old]), condition, noise + 1)])
        new = sampler.sample(concatenate([past, old[:again]]), condition, noise if same else noise + 2)
        found.append((apart(old, new, ahead - 1, ahead - 1 - again), apart(old, new, ahead - 1 + again, ahead - 1)))
    return found


def kept(sampler: Sampler, prompt: str, seed: int, again: int) -> list[tuple[Float, Float]]:
    """Planned again as the live system does."""
    fps = sampler.fps
    ahead = round(LOOKAHEAD_S * fps)
    source = ModelSource(sampler, [Item(0.0, Text(prompt))], prompt, seed)
    found = []
    for moment in range(MOMENTS):
        first = round((SETTLE_S + moment * APART_S) * fps)
        old = source.window(first, ahead + again)
        new = source.window(first + again, ahead)
        if old is None or new is None:
            raise ValueError("a source without an end has ended")
        found.append((apart(old, new, ahead - 1, ahead - 1 - again), apart(old, new, ahead - 1 + again, ahead - 1)))
    return found


def trials(sampler: Sampler, samples: int, again: int) -> list[Trial]:
    """Every prompt, seed and way."""
    done = []
    named = [(kind, prompt, seed) for kind, own in PROMPTS.items() for prompt in own for seed in range(samples)]
    for kind, prompt, seed in track(named, "plans", console=Console(stderr=True)):
        ways: dict[str, Callable[[], list[tuple[Float, Float]]]] = {
            "fresh noise": lambda p=prompt, s=seed: redrawn(sampler, p, s, again, same=False),  # type: ignore[misc]
            "same noise": lambda p=prompt, s=seed: redrawn(sampler, p, s, again, same=True),  # type: ignore[misc]
            "live system": lambda p=prompt, s=seed: kept(sampler, p, s, again),  # type: ignore[misc]
        }
        for way, plan in ways.items():
            done += [Trial(kind, way, *map(float, at_old), later) for at_old, later in plan()]
    return done


def grouped(done: Sequence[Trial]) -> dict[tuple[str, str], list[Trial]]:
    """By way and kind, and all kinds of a way together."""
    groups: dict[tuple[str, str], list[Trial]] = defaultdict(list)
    for trial in done:
        for kind in (trial.kind, "all"):
            groups[trial.way, kind].append(trial)
    return dict(sorted(groups.items(), key=lambda item: (WAYS.index(item[0][0]), [*PROMPTS, "all"].index(item[0][1]))))


def share_90(values: Sequence[float]) -> float:
    """The 90th percentile."""
    return float(np.quantile(values, 0.9))


def table(done: Sequence[Trial]) -> Table:
    """90th percentiles by way and kind."""
    out = Table(title="A plan against the last one: 90th percentile (median)")
    for name in ("way", "prompts", "plans", "root cm", "foot cm", "heading °", "later: root, foot cm, heading °"):
        out.add_column(name, justify="left" if name in ("way", "prompts") else "right")
    for (way, kind), group in grouped(done).items():
        columns = ([1e2 * t.root for t in group], [1e2 * t.foot for t in group], [t.heading for t in group])
        later = np.quantile([t.later for t in group], 0.9, axis=0) * (1e2, 1e2, 1.0)
        cells = [f"{share_90(column):.1f} ({np.median(column):.1f})" for column in columns]
        out.add_row(way, kind, str(len(group)), *cells, ", ".join(f"{value:.1f}" for value in later))
    return out


def draw(done: Sequence[Trial], path: Path) -> None:
    """How the three ways spread."""
    from flexmotion.streamer.plots.palette import LEFT, MIDDLE, MUTED, RIGHT
    from flexmotion.streamer.plots.style import new_figure, save, styled

    with styled():
        figure = new_figure(11, 3.6, "Agreement", "share of plans that are within a distance of the last one, at 1 s")
        panels = (
            ("root [cm]", "root", 1e2, LIMIT_M),
            ("foot [cm]", "foot", 1e2, LIMIT_M),
            ("heading [°]", "heading", 1.0, LIMIT_DEG),
        )
        for axes, (title, name, scale, limit) in zip(figure.subplots(1, 3), panels, strict=True):
            for way, colour in zip(WAYS, (RIGHT, LEFT, MIDDLE), strict=True):
                values = np.sort([scale * getattr(trial, name) for trial in done if trial.way == way])
                axes.step(values, (np.arange(len(values)) + 1) / len(values), color=colour, label=way)
            axes.axvline(scale * limit, color=MUTED, linestyle="--", linewidth=0.8)
            axes.axhline(0.9, color=MUTED, linestyle="--", linewidth=0.8)
            axes.set(xlabel=title, ylim=(0, 1))
        axes.legend(loc="lower right")
        save(figure, path)


def main(
    folder: Annotated[Path, typer.Argument(metavar="BUNDLE", help="Bundle to judge.")],
    samples: Annotated[int, typer.Option(min=1, help="Of each prompt.")] = 10,
    again: Annotated[float, typer.Option(min=0.04, max=0.9, help="Planned again after so long [s].")] = 0.25,
    steps: Annotated[int | None, typer.Option(help="Of the diffusion; the bundle's own by default.")] = None,
    csv_out: Annotated[Path | None, typer.Option("--csv", help="Write one row a plan here.")] = None,
    plots: Annotated[Path | None, typer.Option(help="Folder for pictures.")] = None,
) -> list[Verdict]:
    """Plan again, and compare with the plan before."""
    sampler = Sampler(Bundle(folder), steps)
    frames = round(again * sampler.fps)
    done = trials(sampler, samples, frames)
    console = Console(width=160)
    console.print(table(done))
    console.print(f"planned again after {frames} frames at {sampler.fps:g} fps")
    if csv_out is not None:
        names = ("kind", "way", "root", "foot", "heading")
        write_csv(csv_out, [{name: getattr(trial, name) for name in names} for trial in done])
    if plots is not None:
        plots.mkdir(parents=True, exist_ok=True)
        draw(done, plots / "agreement.png")
    live = [trial for trial in done if trial.way == "live system"]
    figures = [share_90([getattr(trial, name) for trial in live]) for name in ("root", "foot", "heading")]
    return [
        Verdict(f"root at 1 s, live: {100 * figures[0]:.1f} cm (<= 5)", figures[0] <= LIMIT_M),
        Verdict(f"feet at 1 s, live: {100 * figures[1]:.1f} cm (<= 5)", figures[1] <= LIMIT_M),
        Verdict(f"heading at 1 s, live: {figures[2]:.1f}° (<= 3)", figures[2] <= LIMIT_DEG),
    ]


if __name__ == "__main__":
    benchmark(main)
