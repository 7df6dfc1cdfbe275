"""Are eight manners of walking told apart in what the model generates, as they are in real clips?

A logistic regression is trained on real walking of a set (`gait_features`, stretches of 2 s, each clip votes once).
Each manner's sentence is streamed from standing, as it is live; its first seconds are left out. Prints how many clips,
held-out and by five-fold validation over whole clips, and how many samples are classified as what they are, and the
confusions. Fails where below `TOLD_APART` of the samples are. With `--write` the bundle's manifest gets the figure of
each manner.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from typing import Annotated, Any

import numpy as np
import typer
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table

from benchmarks.model.gait_features import gait_features, stretches
from benchmarks.shared.cells import share
from benchmarks.shared.model import open_sampler
from benchmarks.shared.options import BundleArgument, CsvOption, SetOption, WriteOption
from benchmarks.shared.outcome import Outcome, Verdict, write_csv
from benchmarks.shared.streamed import streamed
from flexmotion.bundles.repertoire import write_judged
from flexmotion.configs.judged import Judged
from flexmotion.dataset.compact_set import MotionSet, open_set
from flexmotion.dataset.meaning import clip_kind, clip_manner
from flexmotion.human.motion import Motion
from flexmotion.human.resample import resample
from flexmotion.sampling.sampler import Sampler
from flexmotion.text.manners import NORMAL
from flexmotion.text.phrases import WALK

SENTENCES = {
    NORMAL: "walk forward",
    "energetic": "walk forward full of energy",
    "tired": "walk forward like someone who is worn out",
    "old": "walk forward like an old man",
    "feminine": "walk forward like a lady",
    "youthful": "walk forward like a teenager",
    "masculine": "walk forward like a strong man",
    "childish": "walk forward like a little kid",
}
"""The manners, and the sentences that ask for them."""

TOLD_APART = 0.6
BEGIN_S = 1.5
"""Time in which a sample begins to walk from standing [s]."""

FOLDS = 5
FPS = 30.0

Float = NDArray[np.float64]


class Stretches:
    """Features of stretches, with the clip and the manner of each."""

    def __init__(self) -> None:
        self.features: list[Float] = []
        self.manner: list[str] = []
        self.clip: list[str] = []

    def add(self, motion: Motion, manner: str, clip: str) -> None:
        """Add all stretches of a clip."""
        for part in stretches(motion):
            self.features.append(gait_features(part))
            self.manner.append(manner)
            self.clip.append(clip)

    def of(self, chosen: NDArray[np.bool_]) -> Stretches:
        """Some of them."""
        found = Stretches()
        found.features = [one for one, use in zip(self.features, chosen, strict=True) if use]
        found.manner = [one for one, use in zip(self.manner, chosen, strict=True) if use]
        found.clip = [one for one, use in zip(self.clip, chosen, strict=True) if use]
        return found


def real_walking(found: MotionSet, split: str) -> Stretches:
    """Walking of a split in the manners of `SENTENCES`, at `FPS`."""
    walking = Stretches()
    for clip in found.select(split, "original"):
        labels, captions = clip.info["labels"], [caption["text"] for caption in clip.info["captions"]]
        manner = clip_manner(labels, captions)
        if clip_kind(labels, captions) == WALK and manner in SENTENCES:
            motion = resample(replace(found.motion(clip), activations=None), FPS)
            walking.add(motion, str(manner), clip.name)
    return walking


class MannerJudge:
    """Classifies walking by manner; every clip has one vote.

    Args:
        walking: that it is trained on.
    """

    def __init__(self, walking: Stretches) -> None:
        from sklearn.linear_model import LogisticRegression
        from sklearn.pipeline import make_pipeline
        from sklearn.preprocessing import StandardScaler

        # Strong regularisation: a manner has two to a hundred clips, and stretches of one clip are alike.
        model = LogisticRegression(C=0.05, class_weight="balanced", max_iter=500)
        self._model = make_pipeline(StandardScaler(), model).fit(np.stack(walking.features), walking.manner)

    def __call__(self, walking: Stretches) -> list[tuple[str, str, str]]:
        """Clip, its manner and the manner it is classified as; clips that do not walk are left out."""
        if not walking.features:
            return []
        shares, names = self._model.predict_proba(np.stack(walking.features)), np.array(walking.clip)
        found = []
        for name in dict.fromkeys(walking.clip):
            own = names == name
            heard = str(self._model.classes_[shares[own].mean(axis=0).argmax()])
            found.append((name, walking.manner[walking.clip.index(name)], heard))
        return found


def validated(walking: Stretches) -> list[tuple[str, str, str]]:
    """Clips classified by judges that were trained without them, in `FOLDS` parts."""
    clips = list(dict.fromkeys(walking.clip))
    part = {name: number % FOLDS for number, name in enumerate(_by_manner(walking, clips))}
    found = []
    for fold in range(FOLDS):
        held = np.array([part[name] == fold for name in walking.clip])
        found += MannerJudge(walking.of(~held))(walking.of(held))
    return found


def _by_manner(walking: Stretches, clips: Sequence[str]) -> list[str]:
    """Clips sorted by manner, so that every fold has some of each."""
    manner = dict(zip(walking.clip, walking.manner, strict=True))
    return sorted(clips, key=lambda name: (manner[name], name))


def sampled_walking(sampler: Sampler, samples: int, seconds: float) -> tuple[Stretches, list[tuple[str, str, str]]]:
    """Samples of every sentence whose manner the model knows, and those that do not walk, with the verdict `-`."""
    walking, still = Stretches(), []
    for manner, sentence in SENTENCES.items():
        for seed in range(samples):
            name = f"{manner} {seed}"
            motion = streamed(sampler, sentence, seconds, seed)[round(BEGIN_S * sampler.fps) :]
            before = len(walking.clip)
            walking.add(resample(motion, FPS), manner, name)
            if len(walking.clip) == before:
                still.append((name, manner, "-"))
    return walking, still


def main(
    set_: SetOption,
    bundle: BundleArgument = None,
    samples: Annotated[int, typer.Option(min=1, help="Of each manner.")] = 20,
    seconds: Annotated[float, typer.Option(min=4.0, help="Length of a sample [s].")] = 6.0,
    csv_out: CsvOption = None,
    write: WriteOption = False,
) -> Outcome:
    """Train the judge, sample every manner and classify."""
    found = open_set(set_)
    training, held_out = real_walking(found, "train"), real_walking(found, "validation")
    judge = MannerJudge(training)
    sampler = open_sampler(bundle, unjudged=True)
    generated, still = sampled_walking(sampler, samples, seconds)
    results = {
        "real, held out": judge(held_out),
        f"real, {FOLDS} folds": validated(training),
        "generated": [*judge(generated), *still],
    }
    table = Table("manner", *results, "generated, taken for", title="Manners of walking told apart")
    shares: dict[str, dict[str, float]] = {name: {} for name in results}
    for manner in SENTENCES:
        cells = []
        for name, rows in results.items():
            own = [heard == manner for _, meant, heard in rows if meant == manner]
            if own:
                shares[name][manner] = share(own)
            cells.append(f"{100 * share(own):.0f} % of {len(own)}" if own else "-")
        wrong = [heard for _, meant, heard in results["generated"] if meant == manner and heard != manner]
        others = ", ".join(f"{name} {count}" for name, count in Counter(wrong).most_common())
        table.add_row(manner, *cells, others)
    Console(width=140).print(table)
    if csv_out is not None:
        rows_out: list[dict[str, Any]] = [
            {"of": name, "clip": clip, "manner": meant, "classified": heard}
            for name, rows in results.items()
            for clip, meant, heard in rows
        ]
        write_csv(csv_out, rows_out)
    if write:
        counts = Counter(meant for _, meant, _ in results["generated"])
        judged = {
            manner: Judged(judge="model/manners", samples=counts[manner], share=right, least=TOLD_APART)
            for manner, right in shares["generated"].items()
            if manner in sampler.bundle.manners.names
        }
        write_judged(sampler.bundle, manners=judged)
    overall = {name: share([meant == heard for _, meant, heard in rows]) for name, rows in results.items()}
    generated_share = overall["generated"]
    text = f"told apart in samples: {100 * generated_share:.0f} % (>= {100 * TOLD_APART:.0f} %)"
    text += f"; in real clips: {100 * overall['real, held out']:.0f} % held out"
    return Outcome([Verdict(text, generated_share >= TOLD_APART)], {"overall": overall, "by_manner": shares})
