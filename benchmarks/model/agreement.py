"""Does a redrawn plan agree with the last one while the target stays the same?

At moments of roll-outs a window is sampled, its first quarter of a second is played, and the next window is made from
there in three ways: with fresh noise, with the same noise, and as in the live system, which keeps the frames it has
given and appends to them (`streamer/motion/model_source.py`). Compared at 1 s of the old window: root, farther foot,
heading; "later" at 1 s of the new window, against the old one and the one that would have followed it. Fails where at
1 s, in the live system, the 90th percentile is more than 5 cm or 3 degrees.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from numpy.typing import NDArray
from rich.console import Console
from rich.progress import track
from rich.table import Table

from benchmarks.model.roll_out import always, roll_out
from benchmarks.shared.model import open_sampler
from benchmarks.shared.options import BundleArgument, CsvOption, PlotsOption, StepsOption
from benchmarks.shared.outcome import Outcome, Verdict, write_csv
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
"""The first moment of a roll-out [s], the time between two moments [s], their number."""

WAYS = ("fresh noise", "same noise", "live system")


@dataclass(frozen=True)
class Trial:
    """Distance of two plans.

    Attributes:
        kind, way: of prompt, and how the plan was redrawn.
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
    """Redrawn by sampling: distances at 1 s of the old plan, and of the new one, of each moment."""
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
    """Redrawn as in the live system: likewise."""
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
    done: list[Trial] = []
    named = [(kind, prompt, seed) for kind, own in PROMPTS.items() for prompt in own for seed in range(samples)]
    for kind, prompt, seed in track(named, "plans", console=Console(stderr=True)):
        ways: dict[str, Callable[[], list[tuple[Float, Float]]]] = {
            "fresh noise": lambda p=prompt, s=seed: redrawn(sampler, p, s, again, same=False),  # type: ignore[misc]
            "same noise": lambda p=prompt, s=seed: redrawn(sampler, p, s, again, same=True),  # type: ignore[misc]
            "live system": lambda p=prompt, s=seed: kept(sampler, p, s, again),  # type: ignore[misc]
        }
        for way, plan in ways.items():
            for (root, foot, turn), later in plan():
                done.append(Trial(kind, way, float(root), float(foot), float(turn), later))
    return done


def grouped(done: Sequence[Trial]) -> dict[tuple[str, str], list[Trial]]:
    """By way and kind, and all kinds of a way together."""
    groups: dict[tuple[str, str], list[Trial]] = defaultdict(list)
    for trial in done:
        for kind in (trial.kind, "all"):
            groups[trial.way, kind].append(trial)
    return dict(sorted(groups.items(), key=lambda item: (WAYS.index(item[0][0]), [*PROMPTS, "all"].index(item[0][1]))))


def percentile_90(values: Sequence[float]) -> float:
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
        cells = [f"{percentile_90(column):.1f} ({np.median(column):.1f})" for column in columns]
        out.add_row(way, kind, str(len(group)), *cells, ", ".join(f"{value:.1f}" for value in later))
    return out


def figures_of(group: Sequence[Trial]) -> dict[str, Any]:
    """90th percentiles of a way and kind."""
    scales = {"root": ("root_cm", 1e2), "foot": ("foot_cm", 1e2), "heading": ("heading_deg", 1.0)}
    found = {label: scale * percentile_90([getattr(t, name) for t in group]) for name, (label, scale) in scales.items()}
    return {"plans": len(group)} | found


def draw(done: Sequence[Trial], path: Path) -> None:
    """Distributions of the distances, for each of the three ways."""
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
    bundle: BundleArgument = None,
    samples: Annotated[int, typer.Option(min=1, help="Of each prompt.")] = 10,
    again: Annotated[float, typer.Option(min=0.04, max=0.9, help="Time after which a plan is redrawn [s].")] = 0.25,
    steps: StepsOption = None,
    csv_out: CsvOption = None,
    plots: PlotsOption = None,
) -> Outcome:
    """Redraw plans, and compare each with the plan before."""
    sampler = open_sampler(bundle, steps)
    frames = round(again * sampler.fps)
    done = trials(sampler, samples, frames)
    console = Console(width=160)
    console.print(table(done))
    console.print(f"redrawn after {frames} frames at {sampler.fps:g} fps")
    if csv_out is not None:
        names = ("kind", "way", "root", "foot", "heading")
        write_csv(csv_out, [{name: getattr(trial, name) for name in names} for trial in done])
    if plots is not None:
        plots.mkdir(parents=True, exist_ok=True)
        draw(done, plots / "agreement.png")
    live = [trial for trial in done if trial.way == "live system"]
    root, foot, turn = (percentile_90([getattr(t, name) for t in live]) for name in ("root", "foot", "heading"))
    verdicts = [
        Verdict(f"root at 1 s, live: {100 * root:.1f} cm (<= 5)", root <= LIMIT_M),
        Verdict(f"feet at 1 s, live: {100 * foot:.1f} cm (<= 5)", foot <= LIMIT_M),
        Verdict(f"heading at 1 s, live: {turn:.1f}° (<= 3)", turn <= LIMIT_DEG),
    ]
    return Outcome(verdicts, {f"{way}, {kind}": figures_of(group) for (way, kind), group in grouped(done).items()})
