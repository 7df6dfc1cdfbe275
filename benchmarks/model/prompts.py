"""Does the model do what a prompt asks, in wordings that it was not trained on?

Every wording of `prompts.yaml` and `gesture_prompts.yaml` whose kind the bundle knows is streamed from standing, as it
is live; geometric checks judge the motion, kind by kind. Fails below 95 % of the kinds that the bundle offers, or 85 %
of one of them; the others are told, for a run refuses them by name. With `--write` the bundle's manifest gets the
figure of each kind; one below `OFFERED` is not offered from then on. What was chosen by one seed is to be reported by
another.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from rich.console import Console
from rich.table import Table

from benchmarks.shared.cells import share
from benchmarks.shared.gesture_judges import GESTURE_CHECKS
from benchmarks.shared.judges import SIDES, at_least, frame_velocities, waves
from benchmarks.shared.model import open_sampler
from benchmarks.shared.options import BundleArgument, CsvOption, StepsOption, WriteOption
from benchmarks.shared.outcome import Outcome, Verdict, write_csv
from benchmarks.shared.poses import leaning, raising
from benchmarks.shared.prompts import PromptKind, gesture_kinds, prompt_kinds
from benchmarks.shared.streamed import streamed
from flexmotion.bundles.repertoire import offered_kinds, write_judged
from flexmotion.configs.judged import Judged
from flexmotion.human.kinematics import HumanKinematics, forward
from flexmotion.human.motion import Motion
from flexmotion.sampling.sampler import Sampler
from flexmotion.spatial.heading import continuous_matrix_heading

OVERALL, OFFERED = 0.95, 0.85
"""Share of samples over all offered kinds; and that from which on a kind is offered."""
NONSENSE = "nonsense"
"""What is judged among the kinds and is none: it is to be refused."""
REACH = 0.05
"""A waving hand moves by at least so much between two reversals [m]."""
NEAR = 0.1
"""A hand is up from so far below its shoulder [m]."""
FEWEST = 5
"""A hand that is up for fewer frames does not wave."""


def walks(motion: Motion, human: HumanKinematics, wanted: float) -> bool:
    """Whether the mean speed along the heading reaches a limit [m/s]."""
    return at_least(float(frame_velocities(motion)[:, 0].mean()), wanted)


def sideways(motion: Motion, human: HumanKinematics, wanted: float) -> bool:
    """Whether the mean speed across the heading reaches a limit [m/s], positive to the left."""
    return at_least(float(frame_velocities(motion)[:, 1].mean()), wanted)


def turns(motion: Motion, human: HumanKinematics, wanted: float) -> bool:
    """Whether the heading changes by a limit [degrees], positive to the left."""
    yaw = continuous_matrix_heading(human.pelvis_rotation)
    return at_least(float(np.degrees(yaw[-1] - yaw[0])), wanted)


def stays(motion: Motion, human: HumanKinematics, wanted: float) -> bool:
    """Whether the body ends within a distance of where it began [m]."""
    return bool(np.linalg.norm(motion.root_position[-1, :2] - motion.root_position[0, :2]) <= wanted)


def leans(motion: Motion, human: HumanKinematics, wanted: float) -> bool:
    """Whether the torso leans by an angle at some time [degrees]."""
    return bool(leaning(motion, human, wanted).any())


def rises(motion: Motion, human: HumanKinematics, wanted: str) -> bool:
    """Whether each wanted wrist is above its shoulder at some time."""
    return all(raising(motion, human, side).any() for side in (("left", "right") if wanted == "both" else (wanted,)))


def swings(motion: Motion, human: HumanKinematics, wanted: str) -> bool:
    """Whether each wanted hand waves; `any`: whether one does."""
    if wanted == "any":
        return any(swings(motion, human, side) for side in ("left", "right"))
    for side in SIDES[wanted]:
        raised = human.wrist[:, side, 2] > human.shoulder[:, side, 2] - NEAR
        hand = np.einsum("tji,tj->ti", human.torso_rotation, human.hand[:, side] - human.shoulder[:, side])
        if not waves(hand, raised, REACH, FEWEST):
            return False
    return True


CHECKS: dict[str, Callable[[Motion, HumanKinematics, Any], bool]] = {
    "walks": walks,
    "sideways": sideways,
    "turns": turns,
    "stays": stays,
    "leans": leans,
    "rises": rises,
    "swings": swings,
    **GESTURE_CHECKS,
}
"""By the names that `prompts.yaml` and `gesture_prompts.yaml` use."""


def passed(sampler: Sampler, entry: PromptKind, wording: str, seeds: range, seconds: float) -> list[bool]:
    """Whether the sample of each seed of a wording does what its kind asks."""
    found = []
    for seed in seeds:
        found.append(judged(entry, streamed(sampler, wording, entry.seconds or seconds, seed)))
    return found


def done(sampler: Sampler, entry: PromptKind, seed: int, samples: int, seconds: float) -> list[bool]:
    """`passed` of all wordings of a kind.

    Each has seeds of its own: all are heard as the same, and with the same seeds three wordings were one.
    """
    firsts = (seed + number * samples for number in range(len(entry.wordings)))
    return [
        own
        for wording, first in zip(entry.wordings, firsts, strict=True)
        for own in passed(sampler, entry, wording, range(first, first + samples), seconds)
    ]


def judged(entry: PromptKind, motion: Motion) -> bool:
    """Whether a motion passes all checks of a kind."""
    human = forward(motion)
    return all(CHECKS[name](motion, human, wanted) for name, wanted in entry.check.items())


def main(
    bundle: BundleArgument = None,
    samples: Annotated[int, typer.Option(min=1, help="Of each wording.")] = 20,
    seed: Annotated[int, typer.Option(min=0, help="Of the first sample; 0 has chosen what is offered.")] = 1000,
    seconds: Annotated[float, typer.Option(min=1.0, help="Length of a sample [s].")] = 4.0,
    steps: StepsOption = None,
    csv_out: CsvOption = None,
    write: WriteOption = False,
) -> Outcome:
    """Sample all prompts and judge."""
    sampler, shares = open_sampler(bundle, steps, unjudged=True), {}
    table = Table("kind", "done", "understood as", title="Prompts")
    known = sampler.bundle.prompts.kinds
    # Of none: `NONSENSE`.
    entries = [entry for entry in (*prompt_kinds(), *gesture_kinds()) if entry.of is None or entry.of in known]
    for entry in entries:
        shares[entry.kind] = share(done(sampler, entry, seed, samples, seconds))
        kinds = ", ".join(sampler.prompt(wording).kind for wording in entry.wordings)
        table.add_row(entry.kind, f"{100 * shares[entry.kind]:.0f} %", kinds)
    Console(width=140).print(table)
    judged_bundle = sampler.bundle
    if write:
        figures = {
            entry.of: Judged(
                judge="model/prompts",
                samples=samples * len(entry.wordings),
                share=shares[entry.kind],
                least=OFFERED,
            )
            for entry in entries
            if entry.of is not None
        }
        judged_bundle = write_judged(sampler.bundle, kinds=figures)
    offered = [entry.kind for entry in entries if entry.of is None or entry.of in offered_kinds(judged_bundle)]
    return judged_shares(shares, offered, samples, seed, csv_out)


def judged_shares(
    shares: dict[str, float], offered: Sequence[str], samples: int, seed: int, csv_out: Path | None = None
) -> Outcome:
    """Verdicts on the kinds that are offered, by the share of samples of each kind that were done."""
    overall, worst = float(np.mean([shares[kind] for kind in offered])), min(offered, key=lambda kind: shares[kind])
    left_out = {kind: share for kind, share in shares.items() if kind not in offered}
    if left_out:
        told = ", ".join(f"{kind} ({100 * share:.0f} %)" for kind, share in left_out.items())
        typer.echo(f"not offered, {len(left_out)}: {told}")
    if csv_out is not None:
        write_csv(csv_out, [{"kind": kind, "share": own} for kind, own in [*shares.items(), ("overall", overall)]])
    count = sum(kind != NONSENSE for kind in offered)
    verdicts = [
        Verdict(f"done: {100 * overall:.1f} % of {count} kinds (>= {100 * OVERALL:.0f} %)", overall >= OVERALL),
        Verdict(
            f"worst kind: {worst}, {100 * shares[worst]:.0f} % (>= {100 * OFFERED:.0f} %)", shares[worst] >= OFFERED
        ),
    ]
    return Outcome(
        verdicts,
        {"samples": samples, "seed": seed, "overall": overall, "offered": list(offered), "by_kind": shares},
    )
