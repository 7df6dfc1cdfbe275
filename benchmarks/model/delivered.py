"""Do forces and torques belong to the motion that is delivered, and does the ground give them?

Roll-outs of the live source from standing over prompts that no model was trained on (`benchmarks/shared/prompts.yaml`),
windows joined as they are handed on. A judge of its own differentiates the motion anew and applies the ground forces in
MuJoCo's inverse dynamics (`flexmotion/evaluation/ground.py`). Beside it: the same noise without the projection, as
decoded and as planted (`Sampler(balanced=False)`). Fails where the root's residual is above 2 % of body weight (mean
force), the zero-moment point outside the soles in more than 2 % of the frames with contact, jerk above 1.5 times or
skate above 1.2 times that of the planted motion.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

import numpy as np
import typer
from rich.console import Console
from rich.progress import track
from rich.table import Table

from benchmarks.shared.model import open_bundle
from benchmarks.shared.options import BundleArgument, CsvOption, StepsOption
from benchmarks.shared.outcome import Outcome, Verdict, write_csv
from benchmarks.shared.prompts import prompt_kinds
from flexmotion.evaluation.ground import judge_ground
from flexmotion.evaluation.motions import foot_metrics, jerk
from flexmotion.features.decode import Anchor, decode
from flexmotion.features.encode import body_points
from flexmotion.human.concatenate import concatenate
from flexmotion.human.kinematics import forward
from flexmotion.human.motion import Motion
from flexmotion.sampling.delivery import Delivered
from flexmotion.sampling.sampler import Condition, Sampler
from flexmotion.streamer.motion.intents import Text
from flexmotion.streamer.motion.model_source import ModelSource
from flexmotion.streamer.motion.script import Item

RESIDUAL, OUTSIDE, JERK, SKATE = 2.0, 2.0, 1.5, 1.2
"""Limits: mean force [% of body weight], share of frames [%], ratios to the planted motion."""

SKATING = 0.01
"""Skate ratios smaller than this are compared as this: a ratio of two single frames says nothing."""


@dataclass(frozen=True)
class Row:
    """One roll-out.

    Attributes:
        kind, prompt, seed: of it.
        figures: by name: those of the judge for the delivered motion, and with `planted_` and `decoded_` before them of
            the others; jerk [m/s³] and skate ratio; mean distances of the body's points that planting moves them, and
            that the projection moves them within a window [mm].
    """

    kind: str
    prompt: str
    seed: int
    figures: dict[str, float]


class Before(Sampler):
    """Samples as planted, with the forces as decoded, on the same course; keeps what was decoded, which is on none."""

    decoded: list[Motion]
    moved: list[float]

    def extend(self, history: Motion, condition: Condition, seed: int) -> Delivered:
        """See `Sampler.extend`."""
        features = self.features(history, condition, seed)
        decoded = decode(features, self.layout, self.body, Anchor.after(history))
        found = super().extend(history, condition, seed)
        self.decoded.append(decoded)
        self.moved.append(distance(decoded, self.planted(features, history, condition)))
        return found


class After(Sampler):
    """Samples as delivered; keeps how far from the planted motion, which `unbalanced` samples."""

    unbalanced: Sampler
    moved: list[float]

    def extend(self, history: Motion, condition: Condition, seed: int) -> Delivered:
        """See `Sampler.extend`."""
        found = super().extend(history, condition, seed)
        self.moved.append(distance(self.unbalanced.sample(history, condition, seed), found.window))
        return found


def distance(one: Motion, other: Motion) -> float:
    """Mean distance of the body's points in two motions [mm]."""
    apart = body_points(forward(one)) - body_points(forward(other))
    return 1e3 * float(np.linalg.norm(apart, axis=-1).mean())


def streamed(sampler: Sampler, prompt: str, seed: int, windows: int) -> Motion:
    """The live source's motion from standing, as handed on."""
    source = ModelSource(sampler, [Item(0.0, Text(prompt))], "delivered", seed)
    parts = []
    for first in range(0, windows * sampler.future, sampler.future):
        part = source.window(first, sampler.future)
        assert part is not None
        parts.append(part)
    return concatenate(parts)


def of_motion(motion: Motion) -> dict[str, float]:
    """Figures of a motion: the judge's, jerk and skate ratio."""
    feet = foot_metrics(motion)
    return judge_ground(motion).figures | {"jerk": float(jerk(motion).mean()), "skate": feet["skate_ratio"]}


def measured(before: Before, after: After, kind: str, prompt: str, seed: int, windows: int) -> Row:
    """One roll-out of each pipeline."""
    before.decoded, before.moved, after.moved = [], [], []
    planted = of_motion(streamed(before, prompt, seed, windows))
    delivered = of_motion(streamed(after, prompt, seed, windows))
    single = [of_motion(motion) for motion in before.decoded]
    decoded = {name: float(np.mean([row[name] for row in single])) for name in single[0]}
    figures = delivered | {f"planted_{name}": value for name, value in planted.items()}
    figures |= {f"decoded_{name}": value for name, value in decoded.items()}
    figures |= {"moved_by_planting": float(np.mean(before.moved)), "moved_by_projection": float(np.mean(after.moved))}
    return Row(kind, prompt, seed, figures)


def means(rows: Sequence[Row]) -> dict[str, float]:
    """Mean of every figure."""
    return {name: float(np.mean([row.figures[name] for row in rows])) for name in rows[0].figures}


def by_kind(rows: Sequence[Row]) -> dict[str, dict[str, float]]:
    """`means` of every kind."""
    kinds = dict.fromkeys(row.kind for row in rows)
    return {kind: means([row for row in rows if row.kind == kind]) for kind in kinds}


def table(rows: Sequence[Row]) -> Table:
    """Means by kind: decoded, planted, delivered."""
    out = Table(title="Decoded / planted / delivered")
    columns = ("residual_force", "residual_moment", "zmp_outside", "ground_impossible", "jerk", "skate")
    heads = (
        "force % BW",
        "moment % BW·m",
        "ZMP outside %",
        "impossible %",
        "jerk m/s³",
        "skate",
        "planting, projection mm",
    )
    for name in ("kind", *heads):
        out.add_column(name, justify="left" if name == "kind" else "right")
    for kind in [*dict.fromkeys(row.kind for row in rows), "all"]:
        own = means([row for row in rows if kind in (row.kind, "all")])
        cells = []
        for name in columns:
            digits = 2 if name == "skate" else 1
            cells.append(" / ".join(f"{own[stage + name]:.{digits}f}" for stage in ("decoded_", "planted_", "")))
        out.add_row(kind, *cells, f"{own['moved_by_planting']:.0f}, {own['moved_by_projection']:.0f}")
    return out


def main(
    bundle: BundleArgument = None,
    seeds: Annotated[int, typer.Option(min=1, help="Roll-outs of each prompt.")] = 1,
    first: Annotated[int, typer.Option(min=0, help="First seed.")] = 100,
    windows: Annotated[int, typer.Option(min=2, help="Windows of a roll-out.")] = 5,
    steps: StepsOption = None,
    csv_out: CsvOption = None,
) -> Outcome:
    """Stream prompts and judge their forces."""
    opened = open_bundle(bundle)
    before, after = Before(opened, steps, balanced=False), After(opened, steps)
    after.unbalanced = Sampler(opened, steps, balanced=False)
    cases = [(kind.kind, prompt) for kind in prompt_kinds() for prompt in kind.wordings]
    rows = [
        measured(before, after, kind, prompt, seed, windows)
        for kind, prompt in track(cases, "prompts", console=Console(stderr=True))
        for seed in range(first, first + seeds)
    ]
    Console(width=180).print(table(rows))
    if csv_out is not None:
        write_csv(csv_out, [{"kind": row.kind, "prompt": row.prompt, "seed": row.seed} | row.figures for row in rows])
    found = means(rows)
    rougher = found["jerk"] / found["planted_jerk"]
    skating = max(found["skate"], SKATING) / max(found["planted_skate"], SKATING)
    force, outside = found["residual_force"], found["zmp_outside"]
    return Outcome(
        [
            Verdict(f"residual force: {force:.2f} % of body weight (<= {RESIDUAL:g} %)", force <= RESIDUAL),
            Verdict(f"zero-moment point outside the soles: {outside:.1f} % (<= {OUTSIDE:g} %)", outside <= OUTSIDE),
            Verdict(f"jerk relative to the planted motion: {rougher:.2f} (<= {JERK:g})", rougher <= JERK),
            Verdict(f"skate relative to the planted motion: {skating:.2f} (<= {SKATE:g})", skating <= SKATE),
        ],
        found | {"by_kind": by_kind(rows)},
    )
