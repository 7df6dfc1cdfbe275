"""Are gestures made beside a walk or a turn, and is the walk as far as without them?

Every offered gesture of arms or head, in a wording that the model was not trained on, beside every motion of
`prompts.yaml` that leaves its limbs free, streamed from standing, as it is live. The judges of `model/prompts` judge
the gesture and the motion in the same sample, but for the place that a gesture keeps. The way is compared with that of
the same motion, seeds and time without a gesture.
"""

from __future__ import annotations

from typing import Annotated, Any

import numpy as np
import typer
from rich.console import Console
from rich.table import Table

from benchmarks.model.prompts import CHECKS, judged
from benchmarks.shared.model import open_sampler
from benchmarks.shared.options import BundleArgument
from benchmarks.shared.outcome import Outcome, Verdict
from benchmarks.shared.prompts import PromptKind, gesture_kinds, prompt_kinds
from flexmotion.human.kinematics import forward
from flexmotion.human.motion import Motion
from flexmotion.sampling.beside import fits_beside
from flexmotion.sampling.sampler import Sampler
from flexmotion.streamer.motion.intents import Text
from flexmotion.streamer.motion.model_source import ModelSource
from flexmotion.text.phrases import STAND

OVERALL, WORST, WAY = 0.95, 0.85, 0.1
"""Share of samples of all pairs and of the worst gesture or motion; how far the mean way may differ, as a share."""
PLACE = "stays"
"""The check of gestures that keep their place, which is not judged."""


def made(sampler: Sampler, intent: Text, seconds: float, seed: int) -> Motion:
    """Motion of words and of the gesture beside them, from standing."""
    source = ModelSource(sampler, (), intent.text, seed)
    source.steer(intent)
    motion = source.window(0, round(seconds * sampler.fps))
    assert motion is not None
    return motion


def gestures(motion: Motion, entry: PromptKind) -> bool:
    """Whether a motion passes the checks of a gesture that do not ask for its place."""
    human = forward(motion)
    return all(CHECKS[name](motion, human, wanted) for name, wanted in entry.check.items() if name != PLACE)


def main(
    bundle: BundleArgument = None,
    samples: Annotated[int, typer.Option(min=1, help="Of each pair.")] = 2,
    seed: Annotated[int, typer.Option(min=0, help="Of the first sample.")] = 1000,
    seconds: Annotated[float, typer.Option(min=1.0, help="Length of a sample [s].")] = 5.0,
) -> Outcome:
    """Sample all pairs and judge."""
    sampler = open_sampler(bundle)
    entries = [entry for entry in (*prompt_kinds(), *gesture_kinds()) if entry.of in sampler.requests.reader.offered]
    mains = [entry for entry in entries if entry.moves]
    rows: list[dict[str, Any]] = []
    table = Table("motion", "gestures", "gesture done", "motion done", "way", "not done", title="Two motions at once")
    for main_entry in mains:
        kind, (words, *_) = str(main_entry.of), main_entry.wordings
        seeds = range(seed, seed + samples)
        alone = float(np.mean([way(made(sampler, Text(words), seconds, one)) for one in seeds]))
        own = []
        for entry in entries:
            if entry.of == STAND or not fits_beside(str(entry.of), kind):
                continue
            for one in seeds:
                motion = made(sampler, Text(words, beside=Text(entry.wordings[0])), seconds, one)
                did = {"gesture_done": gestures(motion, entry), "motion_done": judged(main_entry, motion)}
                own.append({"motion": kind, "gesture": entry.of, **did, "way": way(motion) / alone})
        missed = sorted({str(row["gesture"]) for row in own if not row["gesture_done"]})
        table.add_row(
            kind,
            str(len(own) // samples),
            *(f"{100 * np.mean([row[name] for row in own]):.0f} %" for name in ("gesture_done", "motion_done")),
            f"{np.mean([row['way'] for row in own]):.2f}",
            ", ".join(missed),
        )
        rows += own
    Console(width=140).print(table)
    return outcome(rows, samples, seed)


def way(motion: Motion) -> float:
    """How far a motion leads [m]."""
    return float(np.linalg.norm(motion.root_position[-1, :2] - motion.root_position[0, :2]))


def outcome(rows: list[dict[str, Any]], samples: int, seed: int) -> Outcome:
    """Verdicts over all pairs, and on the worst of them."""
    verdicts, figures = [], dict[str, Any](samples=samples, seed=seed, pairs=len(rows) // samples)
    for name, by, what in (("gesture_done", "gesture", "gestures"), ("motion_done", "motion", "motions")):
        shares = {one: float(np.mean([row[name] for row in rows if row[by] == one])) for one in _kinds(rows, by)}
        overall, worst = float(np.mean([row[name] for row in rows])), min(shares, key=lambda one: shares[one])
        figures |= {f"{what}_done": overall, f"{what}_by_kind": shares}
        verdicts += [
            Verdict(
                f"{what} done: {100 * overall:.1f} % of {len(rows)} (>= {100 * OVERALL:.0f} %)", overall >= OVERALL
            ),
            Verdict(
                f"worst of the {what}: {worst}, {100 * shares[worst]:.0f} % (>= {100 * WORST:.0f} %)",
                shares[worst] >= WORST,
            ),
        ]
    ways = {
        kind: float(np.mean([row["way"] for row in rows if row["motion"] == kind])) for kind in _kinds(rows, "motion")
    }
    off = max(ways, key=lambda kind: abs(ways[kind] - 1.0))
    figures["way"] = ways
    verdicts.append(
        Verdict(
            f"way over that without a gesture, furthest off: {off}, {ways[off]:.2f} (1 ± {WAY:g})",
            abs(ways[off] - 1) <= WAY,
        )
    )
    return Outcome(verdicts, figures)


def _kinds(rows: list[dict[str, Any]], name: str) -> list[str]:
    return list(dict.fromkeys(str(row[name]) for row in rows))
