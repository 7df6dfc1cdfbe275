"""Does personalisation reach what was shown, and does it keep the rest?

Samples every kind of motion from standing with the same noise: of the model before, of the personalised one in the
normal manner, and of the personalised one in the person's. Prints by kind how far the points of the body are from those
of the model before. Fails where kinds in the normal manner moved by more than `KEPT` of what the shown kinds did in the
person's manner. `model/prompts` of both bundles says whether they still do what is asked.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table

from benchmarks.model.roll_out import Cue, roll_out
from benchmarks.shared.model import open_sampler
from benchmarks.shared.options import CsvOption
from benchmarks.shared.outcome import Outcome, Verdict, write_csv
from flexmotion.configs.errors import ConfigError
from flexmotion.human.kinematics import forward
from flexmotion.human.motion import Motion
from flexmotion.sampling.sampler import Condition, Sampler
from flexmotion.text.manners import NORMAL
from flexmotion.text.phrases import STAND, wordings

KEPT = 0.1


def points(motion: Motion) -> NDArray[np.float64]:
    """Joint centres, hands and head against the pelvis, in its heading axes of the first frame, (T, P, 3) [m]."""
    human = forward(motion)
    sided = [human.knee, human.ankle, human.toe, human.elbow, human.wrist, human.hand]
    found = np.concatenate([*sided, human.vertex[:, None]], axis=1)
    relative: NDArray[np.float64] = found - human.pelvis_position[:, None]
    return relative


def distance(first: Motion, second: Motion) -> float:
    """Mean distance of the points of two motions, frame by frame [m]."""
    return float(np.linalg.norm(points(first) - points(second), axis=2).mean())


def sampled(sampler: Sampler, kind: str, manner: str, seconds: float, seed: int) -> Motion:
    """A sample of a kind in a manner."""
    known = manner in sampler.requests.manners
    condition = Condition(wordings(kind)[0], manner=manner if known else None)
    return roll_out(sampler, [Cue(0.0, condition)], seconds, seed).motion


def main(
    before: Annotated[Path, typer.Argument(metavar="BEFORE", help="Bundle of the model before.")],
    after: Annotated[Path, typer.Argument(metavar="AFTER", help="Bundle of the personalised model.")],
    manner: Annotated[str, typer.Option(help='The person\'s manner, such as "like Ada".')],
    shown: Annotated[str, typer.Option(help="Kinds of motion in the person's clips, with commas between them.")],
    samples: Annotated[int, typer.Option(min=1, help="Of each kind.")] = 8,
    seconds: Annotated[float, typer.Option(min=1.0, help="Length of a sample [s].")] = 3.0,
    csv_out: CsvOption = None,
) -> Outcome:
    """Sample both bundles and compare."""
    old, new = (open_sampler(folder, unjudged=True) for folder in (before, after))
    if manner not in new.requests.manners:
        raise ConfigError(f"{after}: manner {manner!r}, the model knows {', '.join(new.requests.manners)}")
    kinds = [kind for kind in dict.fromkeys(old.bundle.prompts.kinds) if kind != STAND]
    own = [kind.strip() for kind in shown.split(",")]
    if unknown := sorted(set(own) - set(kinds)):
        raise ConfigError(f"--shown: {unknown[0]!r}, expected kinds of {before}: {', '.join(kinds)}")
    table = Table(
        "kind", "normal, moved by", f"{manner}, moved by", title="Before and after, mean of the body's points"
    )
    rows = []
    for kind in kinds:
        moved = {NORMAL: [], manner: []}  # type: dict[str, list[float]]
        for seed in range(samples):
            base = sampled(old, kind, NORMAL, seconds, seed)
            for name, found in moved.items():
                found.append(distance(base, sampled(new, kind, name, seconds, seed)))
        kept, learnt = (float(np.mean(moved[name])) for name in (NORMAL, manner))
        rows.append({"kind": kind, "shown": kind in own, "normal_m": kept, "personal_m": learnt})
        table.add_row(f"{kind} (shown)" if kind in own else kind, f"{100 * kept:.2f} cm", f"{100 * learnt:.2f} cm")
    Console(width=140).print(table)
    if csv_out is not None:
        write_csv(csv_out, rows)
    kept = float(np.mean([row["normal_m"] for row in rows]))
    learnt = float(np.mean([row["personal_m"] for row in rows if row["shown"]]))
    ratio = kept / learnt if learnt else float("inf")
    text = f"kept: normal motion moved by {100 * kept:.1f} cm, {100 * ratio:.0f} % of the {100 * learnt:.1f} cm learnt"
    figures = {"kept_m": kept, "learnt_m": learnt, "ratio": ratio}
    return Outcome([Verdict(f"{text} (<= {100 * KEPT:.0f} %)", ratio <= KEPT)], figures)
