"""Does anything that is asked begin faster, or bend further, than people do it?

Every offered kind is asked of a standing human, and after every other kind. Of the recorded clips of a kind in the
normal manner (in any, where there are fewer than `FEWEST`) the 99.9th percentile over their frames is the limit: of
the speed of the faster hand relative to the pelvis, of that of the faster ankle, and of how far the trunk has turned
from where it was at first: people lean each in their way. From a stand no frame of a sample may be beyond the limits of
its kind. Of a change of kinds the hands are compared with the fastest of all gestures of the normal manner: an arm on
its way from one pose to the other is of neither kind.
"""

from __future__ import annotations

from collections import defaultdict
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from numpy.typing import NDArray
from rich.console import Console
from rich.progress import track
from rich.table import Table

from benchmarks.model.posture_figures import on_body
from benchmarks.model.real_clips import kind_of, real_clips
from benchmarks.shared.model import open_sampler
from benchmarks.shared.options import BundleArgument, CsvOption, SetOption
from benchmarks.shared.outcome import Outcome, Verdict, write_csv
from benchmarks.shared.prompts import gesture_kinds, prompt_kinds
from flexmotion.configs.errors import ConfigError
from flexmotion.dataset.compact_set import MotionSet, open_set
from flexmotion.human.kinematics import forward
from flexmotion.human.motion import Motion
from flexmotion.sampling.beside import fits_beside
from flexmotion.sampling.sampler import Sampler
from flexmotion.streamer.motion.intents import Text
from flexmotion.streamer.motion.model_source import ModelSource
from flexmotion.streamer.motion.script import Item
from flexmotion.text.manners import NORMAL
from flexmotion.text.phrases import STAND
from flexmotion.text.sides import mirrored, sides

Float = NDArray[np.float64]

FIGURES = {"hand": "m/s", "foot": "m/s", "bend": "°"}
"""What is compared, and its unit."""
LEAST = {"hand": 0.5, "foot": 0.3, "bend": 20.0}
"""Below this nothing is fast or far: a foot that gives way, a hand that a nodding human moves."""
PERCENTILE, FEWEST = 99.9, 5
BEGINS_S, CHANGES_S, LONG_S = 1.0, 2.0, 4.5
"""When a kind is asked of a standing human, when after another kind, and length of a sample [s]."""
FAST, FASTEST = 0.02, 2.0
"""Share of changes with a hand faster than the fastest gesture of people; the fastest of them over that gesture."""


def figures(motion: Motion) -> dict[str, Float]:
    """Hand and foot [m/s], (T - 1,), and bend from the first frame [°], (T,), of every frame."""
    human = forward(motion)
    hands = np.einsum("tji,tsj->tsi", human.pelvis_rotation, human.wrist - human.pelvis_position[:, None])
    speeds = (np.linalg.norm(np.diff(each, axis=0), axis=-1).max(axis=1) * motion.fps for each in (hands, human.ankle))
    bend = np.arccos(np.clip(human.torso_rotation[..., 2] @ human.torso_rotation[0, :, 2], -1.0, 1.0))
    return dict(zip(FIGURES, (*speeds, np.degrees(bend)), strict=True))


def limits(found: MotionSet, sampler: Sampler) -> tuple[dict[str, dict[str, float]], set[str]]:
    """The limits of people by kind and figure, on the sampler's body; and the kinds that they are of any manner for.

    Mirror images are one kind.
    """
    frames: dict[bool, dict[str, list[dict[str, Float]]]] = {True: defaultdict(list), False: defaultdict(list)}
    for split in ("train", "validation"):
        for clip, motion in real_clips(found, split, sampler.fps):
            own = figures(on_body(motion, sampler.body))
            for normal in {False, clip.info["labels"].get("style") == NORMAL}:
                frames[normal][_one_side(kind_of(clip))].append(own)
    kept = {
        kind: frames[True][kind] if len(frames[True][kind]) >= FEWEST else every
        for kind, every in frames[False].items()
        if len(every) >= FEWEST
    }
    most = {
        kind: {name: float(np.percentile(np.concatenate([one[name] for one in own]), PERCENTILE)) for name in FIGURES}
        for kind, own in kept.items()
    }
    return most, {kind for kind in kept if len(frames[True][kind]) < FEWEST}


def _one_side(kind: str) -> str:
    return mirrored(kind) if sides(kind) == {"left"} else kind


def streamed(sampler: Sampler, words: tuple[str, str], begins_s: float, seed: int) -> Motion:
    """The live source's motion of words after others, from `begins_s` on, to `LONG_S`."""
    items = [Item(0.0, Text(words[0])), Item(begins_s, Text(words[1]))]
    motion = ModelSource(sampler, items, "onsets", seed, seconds=LONG_S).human()
    return motion[round(begins_s * sampler.fps) :]


def main(
    set_folder: SetOption = Path("set"),
    bundle: BundleArgument = None,
    samples: Annotated[int, typer.Option(min=1, help="Of each kind, from a stand.")] = 6,
    seed: Annotated[int, typer.Option(min=0, help="Of the first sample.")] = 1000,
    csv: CsvOption = None,
) -> Outcome:
    """Sample all kinds from a stand and after each other, and compare them with clips."""
    sampler = open_sampler(bundle)
    people, any_manner = limits(open_set(set_folder), sampler)
    kinds = {
        str(entry.of): entry.wordings[0]
        for entry in (*prompt_kinds(), *gesture_kinds())
        if entry.of in sampler.requests.reader.offered
    }
    rows: list[dict[str, Any]] = []
    table = Table("kind", *(f"{name} {unit}" for name, unit in FIGURES.items()), title="Samples / people")
    for kind in track([kind for kind in kinds if _one_side(kind) in people and kind != STAND], "from a stand"):
        made = [streamed(sampler, (kinds[STAND], kinds[kind]), BEGINS_S, seed + one) for one in range(samples)]
        own = {name: max(float(figures(one)[name].max()) for one in made) for name in FIGURES}
        limit = {name: max(people[_one_side(kind)][name], LEAST[name]) for name in FIGURES}
        table.add_row(kind, *(_cell(own[name], limit[name]) for name in FIGURES))
        over = {f"{name}_over": own[name] / limit[name] for name in FIGURES}
        rows.append({"before": STAND, "kind": kind} | own | over)
    Console(width=100).print(table)
    pairs = [(first, second) for first in kinds for second in kinds if first != second and STAND not in (first, second)]
    changes = []
    for number, (first, second) in enumerate(track(pairs, "after each other")):
        motion = streamed(sampler, (kinds[first], kinds[second]), CHANGES_S, seed + number)
        changes.append({"before": first, "kind": second, "hand": float(figures(motion)["hand"].max())})
    if csv is not None:
        write_csv(csv, rows + changes)
    calm = [kind for kind in people if kind in kinds and kind not in any_manner and fits_beside(kind, STAND)]
    if not calm or not changes:
        wanted = f"{FEWEST} clips of a gesture, and of another kind, that the bundle offers"
        raise ConfigError(f"{set_folder}: expected {wanted}")
    return outcome(rows, changes, max(people[kind]["hand"] for kind in calm))


def _cell(own: float, limit: float) -> str:
    text = f"{own:.1f} / {limit:.1f}"
    return f"[bold]{text}[/bold]" if own > limit else text


def outcome(rows: list[dict[str, Any]], changes: list[dict[str, Any]], gesture: float) -> Outcome:
    """Verdicts on every figure from a stand, and on the hands of changes; `gesture`: the fastest of people [m/s]."""
    verdicts, kept = [], dict[str, Any](by_kind={row["kind"]: row for row in rows})
    for name in FIGURES:
        over = [row[f"{name}_over"] for row in rows]
        worst = int(np.argmax(over))
        within = sum(one <= 1.0 for one in over)
        verdicts.append(
            Verdict(
                f"from a stand, {name}: {within} of {len(rows)} kinds within people's {PERCENTILE:g}th percentile, "
                f"worst {rows[worst]['kind']} {over[worst]:.2f} of it",
                within == len(rows),
            )
        )
    hands = np.array([change["hand"] for change in changes])
    share, fastest = float((hands > gesture).mean()), changes[int(hands.argmax())]
    kept |= {"gesture": gesture, "changes": len(hands), "fast": share, "fastest": fastest}
    kept["hands"] = {f"p{at:g}": float(np.percentile(hands, at)) for at in (50, 90, 99, 99.9, 100)}
    verdicts += [
        Verdict(
            f"{len(hands)} changes: a hand is faster than people's fastest gesture ({gesture:.1f} m/s) in "
            f"{100 * share:.1f} % (<= {100 * FAST:g} %)",
            share <= FAST,
        ),
        Verdict(
            f"the fastest, {fastest['before']} to {fastest['kind']}: {fastest['hand']:.1f} m/s "
            f"(<= {FASTEST * gesture:.1f})",
            fastest["hand"] <= FASTEST * gesture,
        ),
    ]
    return Outcome(verdicts, kept)
