"""Is a person's manner learnt from a few clips, and does it leave all else as it was?

Personalises TRAINING, a folder or a weights file, to the clips of `--set` or of the motion data in `--clips`, distils a
student and exports the bundle of the person: all of it in OUT, by the commands of `flexmotion`. What is there already
is not done again, what was stopped goes on. Then every kind of motion is sampled from standing with the same noise: of
the model before, of the personalised one in the same manners, and in the person's. Prints by kind how far the points of
the body are from those of the model before; how near postures are to those of the person's clips (`posture_distance`),
of kinds that were shown, and of kinds in `--held-out`, clips of the person that the training has not seen; and the
share of samples that do what is asked (the judges of `model/prompts`). Fails where anything that is not asked in the
person's manner has moved at all, where shown kinds are not a fifth nearer to the person's clips than before, or where
less than .9 of what was done before is done in the person's manner.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from numpy.typing import NDArray
from rich.console import Console
from rich.progress import track
from rich.table import Table

from benchmarks.model.posture_distance import Float, posture_distance, postures
from benchmarks.model.prompts import OFFERED, judged
from benchmarks.model.real_clips import kind_of, real_clips
from benchmarks.model.roll_out import Cue, roll_out
from benchmarks.shared.options import CsvOption
from benchmarks.shared.outcome import Outcome, Verdict, write_csv
from benchmarks.shared.prompts import gesture_kinds, prompt_kinds
from flexmotion.bundles.bundle import Bundle
from flexmotion.bundles.repertoire import offered_kinds
from flexmotion.bundles.shipped import bundle_folder
from flexmotion.configs.errors import ConfigError
from flexmotion.dataset.compact_set import open_set
from flexmotion.human.kinematics import forward
from flexmotion.human.motion import Motion
from flexmotion.sampling.sampler import Condition, Sampler
from flexmotion.streamer.cli import execute
from flexmotion.text.manners import NORMAL
from flexmotion.text.phrases import ALIASES, STAND, WALK, wordings
from flexmotion.training.checkpoints import is_trained, training_record
from flexmotion.training.personal import personal_run, training_of
from flexmotion.training.run import Run

NEARER, DONE = 0.8, 0.9
"""Greatest distance of shown kinds from the person's clips over that before; least share that does what is asked, over
that before."""

BEGIN_S = 1.5
"""Time in which a sample begins to travel from standing [s]; it is left out where postures are compared."""

TRAVELS = 0.3
"""Clips that are faster than this on average travel [m/s]."""

WORDINGS = 2
"""Wordings of each kind that are judged."""


@dataclass(frozen=True)
class Clips:
    """The person's clips of one kind.

    Attributes:
        postures: of every clip, (T, C).
        shown: whether the training has seen them.
        travels: whether they get from place to place.
    """

    postures: Sequence[Float]
    shown: bool
    travels: bool

    @property
    def apart(self) -> float | None:
        """Mean distance of two of them [m]; None of one alone."""
        pairs = [posture_distance(*pair) for at, one in enumerate(self.postures) for pair in self._with_later(at, one)]
        return float(np.mean(pairs)) if pairs else None

    def _with_later(self, at: int, one: Float) -> list[tuple[Float, Float]]:
        return [(one, other) for other in self.postures[at + 1 :]]

    def distance(self, motions: Sequence[Motion], sampler: Sampler) -> float:
        """Distance of samples from the clips [m]."""
        begin = round(BEGIN_S * sampler.fps) if self.travels else 0
        own = postures([motion[begin:] for motion in motions], sampler.body)
        return posture_distance(own, np.concatenate(list(self.postures)))


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


def sampled(sampler: Sampler, text: str, manner: str | None, seconds: float, seed: int) -> Motion:
    """A sample of a text in a manner; None for the one that it says."""
    return roll_out(sampler, [Cue(0.0, Condition(text, manner=manner))], seconds, seed).motion


def moved(old: Sampler, new: Sampler, seconds: float, seed: int) -> float:
    """How far samples are off that are not asked in a person's manner, at most [m].

    Of walking in every manner of the model before, and of velocities; kinds are in the rows of the table.
    """
    cues = [[Cue(0.0, Condition(wordings(WALK)[0], manner=manner))] for manner in old.requests.manners]
    cues += [[Cue(0.0, Condition(velocity=asked))] for asked in ((0.5, 0.0, 0.0), (0.0, 0.2, 0.0), (0.3, 0.0, 0.5))]
    each = ((roll_out(sampler, cue, seconds, seed).motion for sampler in (old, new)) for cue in cues)
    return max(distance(*pair) for pair in each)


def clips_of(data: Path, sampler: Sampler, *, shown: bool) -> dict[str, Clips]:
    """Recorded clips of a set by the kind of motion that a bundle knows them as."""
    known, found = set(sampler.bundle.prompts.kinds), defaultdict(list)
    source = open_set(data)
    for split in ("train", "validation"):
        for clip, motion in real_clips(source, split, sampler.fps):
            kind = ALIASES.get(kind_of(clip), kind_of(clip))
            if kind in known:
                found[kind].append(motion)
    return {
        kind: Clips([postures([clip], sampler.body) for clip in clips], shown, _speed(clips) > TRAVELS)
        for kind, clips in found.items()
    }


def _speed(clips: Sequence[Motion]) -> float:
    steps = [np.linalg.norm(np.diff(clip.root_position[:, :2], axis=0), axis=1) * clip.fps for clip in clips]
    return float(np.concatenate(steps).mean())


def done(sampler: Sampler, manner: str, samples: int, seed: int) -> dict[str, list[bool]]:
    """Whether samples do what is asked, by kind of motion; `manner`: words that follow every sentence."""
    known, found = offered_kinds(sampler.bundle), defaultdict(list)
    entries = [entry for entry in (*prompt_kinds(), *gesture_kinds()) if entry.of in known and entry.of != STAND]
    for entry in track(entries, "judges", transient=True):
        for wording in entry.wordings[:WORDINGS]:
            for number in range(seed, seed + samples):
                motion = sampled(sampler, f"{wording} {manner}".strip(), None, entry.seconds or 4.0, number)
                found[str(entry.of)].append(judged(entry, motion))
    return found


def personalised(
    training: Path, out: Path, data: Path, manner: str, prior: Path | None, steps: int, student: int
) -> Run:
    """The personalised training in `out`, with its student; both are trained as far as they are not."""
    run = personal_run(training_of(training, out), out, manner)
    common = ["-o", str(out), "--threads", "1", "--steps"]
    if not _is_done(run.stage("diffusion"), steps):
        more = [] if prior is None else ["--prior", str(prior)]
        command("personalize", str(training), "--set", str(data), "--manner", manner, *more, *common, str(steps))
    if not _is_done(run.stage("distill"), student):
        command("train", "distill", *common, str(student))
    return run


def _is_done(stage: Path, steps: int) -> bool:
    return is_trained(stage) and training_record(stage).steps >= steps


def command(*words: str) -> None:
    """A command of `flexmotion`; raises `ConfigError` where it ends with another code than 0."""
    code = execute(list(words))
    if code:
        raise ConfigError(f"flexmotion {' '.join(words)}: ended with {code}")


def bundles_of(run: Run, out: Path, onto: str | None) -> tuple[Bundle, Bundle]:
    """Bundles of the model before and of the personalised one, exported anew."""
    if onto is None:
        command("export", str(run.before().folder), "-o", str(out / "before"))
    before = Bundle(out / "before" if onto is None else bundle_folder(onto))
    command("export", str(run.folder), "--onto", str(before.folder), "-o", str(out / "bundle"))
    return before, Bundle(out / "bundle")


def main(
    training: Annotated[Path, typer.Argument(metavar="TRAINING|WEIGHTS", help="Model that is personalised.")],
    out: Annotated[Path, typer.Argument(metavar="OUT", help="Folder for what is made here.")],
    manner: Annotated[str, typer.Option(help="Words that ask for the person's manner.")] = "like Ada",
    clips: Annotated[Path | None, typer.Option(help="Motion data of the person, of which a set is built.")] = None,
    data: Annotated[Path | None, typer.Option("--set", help="Or the set, of `data build`.")] = None,
    held_out: Annotated[
        Path | None, typer.Option(help="Set of further clips of the person, of any kinds of motion.")
    ] = None,
    prior: Annotated[Path | None, typer.Option(help="Set of other people's clips; else own samples.")] = None,
    onto: Annotated[
        str | None, typer.Option(help="Bundle of the model before, by name or folder; else it is exported.")
    ] = None,
    steps: Annotated[int, typer.Option(min=1, help="Of the personalisation.")] = 500,
    student: Annotated[int, typer.Option(min=1, help="Steps of its distillation.")] = 400,
    samples: Annotated[int, typer.Option(min=1, help="Of each kind; half as many of each wording are judged.")] = 8,
    seconds: Annotated[float, typer.Option(min=2.0, help="Length of a sample [s].")] = 4.0,
    seed: Annotated[int, typer.Option(min=0, help="Of the first sample.")] = 1000,
    csv_out: CsvOption = None,
) -> Outcome:
    """Train and export what is not there, sample both bundles and compare."""
    if data is None and clips is None:
        raise typer.BadParameter("give --clips or --set")
    if data is None:
        data = out / "set"
        if not (data / "manifest.json").is_file():
            command("data", "build", str(clips), "-o", str(data), "--workers", "1")
    run = personalised(training, out / "training", data, manner, prior, steps, student)
    before, after = bundles_of(run, out, onto)
    old, new = (Sampler(bundle, unjudged=True) for bundle in (before, after))
    hers = {} if held_out is None else clips_of(held_out, old, shown=False)
    hers |= clips_of(data, old, shown=True)
    rows = rows_of(old, new, manner, hers, samples, seconds, seed)
    each = max(1, samples // 2)
    for name, each_done in (("done_before", done(old, "", each, seed)), ("done", done(new, manner, each, seed))):
        for kind, right in each_done.items():
            rows[kind][name] = float(np.mean(right))
    others = moved(old, new, seconds, seed)
    Console(width=140).print(table(rows, manner))
    if csv_out is not None:
        names = list(dict.fromkeys(name for row in rows.values() for name in row))
        write_csv(csv_out, [{"kind": kind} | dict.fromkeys(names, "") | row for kind, row in rows.items()])
    found, undone = overall(rows, others), weak(rows)
    if undone:
        typer.echo(f"{manner}, done in less than {100 * OFFERED:.0f} %: {', '.join(undone)}")
    return Outcome(verdicts(found), {"overall": found, "weak": undone, **rows})


Rows = dict[str, dict[str, float | str]]


def rows_of(
    old: Sampler, new: Sampler, manner: str, hers: Mapping[str, Clips], samples: int, seconds: float, seed: int
) -> Rows:
    """Figures of every kind of motion but standing, distances in cm."""
    rows: Rows = {}
    kinds = [kind for kind in offered_kinds(old.bundle) if kind != STAND]
    for kind in track(kinds, "samples", transient=True):
        text, seeds = wordings(kind)[0], range(seed, seed + samples)
        base = [sampled(old, text, NORMAL, seconds, number) for number in seeds]
        same = [sampled(new, text, NORMAL, seconds, number) for number in seeds]
        own = [sampled(new, text, manner, seconds, number) for number in seeds]
        row = rows[kind] = {"clips": ""}
        row["normal_cm"] = 100 * max(map(distance, base, same))
        row["personal_cm"] = 100 * float(np.mean([*map(distance, base, own)]))
        if kind in hers:
            row["clips"] = "shown" if hers[kind].shown else "held out"
            row |= {
                f"{name}_cm": 100 * hers[kind].distance(made, old) for name, made in (("before", base), ("after", own))
            }
            if (apart := hers[kind].apart) is not None:
                row["apart_cm"] = 100 * apart
    return rows


def overall(rows: Rows, others_m: float) -> dict[str, float]:
    """Figures over the kinds of motion; a kind that no clip or judge has does not count."""

    def mean(name: str, clips: str | None = None) -> float:
        values = [float(row[name]) for row in rows.values() if name in row and clips in (None, row["clips"])]
        return float(np.mean(values)) if values else np.nan

    found = {"normal_cm": max(100 * others_m, *(float(row["normal_cm"]) for row in rows.values()))}
    for clips, name in (("shown", "shown"), ("held out", "held_out")):
        found |= {f"{name}_{at}_cm": mean(f"{at}_cm", clips) for at in ("before", "after")}
        found[f"{name}_personal_cm"] = mean("personal_cm", clips)
    found["unseen_personal_cm"] = mean("personal_cm", "")
    return found | {name: mean(name) for name in ("done_before", "done")}


def weak(rows: Rows) -> list[str]:
    """Kinds that a judge would not offer in the person's manner, as it does in the normal one."""
    judged = {kind: row for kind, row in rows.items() if "done" in row}
    return [kind for kind, row in judged.items() if float(row["done"]) < OFFERED <= float(row["done_before"])]


def verdicts(found: Mapping[str, float]) -> list[Verdict]:
    """What must hold."""
    moved_cm, nearer = found["normal_cm"], found["shown_after_cm"] / found["shown_before_cm"]
    right = found["done"] / found["done_before"]
    far = f"{found['shown_after_cm']:.2f} cm from the person's clips, {nearer:.2f} of before (<= {NEARER})"
    return [
        Verdict(f"not asked in the person's manner: moved by {moved_cm:.3g} cm (0)", moved_cm == 0.0),
        Verdict(f"shown kinds: {far}", nearer <= NEARER),
        Verdict(f"done in the person's manner: {right:.2f} of what was done before (>= {DONE})", right >= DONE),
    ]


def table(rows: Rows, manner: str) -> Table:
    """One kind a line."""
    made = Table(
        "kind", "the person's", "normal, moved", f"{manner}, moved", "from clips, before", "now", "done", "now"
    )
    for kind, row in rows.items():
        near = [f"{row[name]:.2f} cm" if name in row else "" for name in ("before_cm", "after_cm")]
        right = [f"{100 * float(row[name]):.0f} %" if name in row else "" for name in ("done_before", "done")]
        moved_by = [f"{row[name]:.3g} cm" for name in ("normal_cm", "personal_cm")]
        made.add_row(kind, str(row["clips"]), *moved_by, *near, *right)
    return made
