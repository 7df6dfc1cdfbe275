"""`make_gestures`: folders of recordings to a folder of gestures, with index and captions, for `data build`."""

from __future__ import annotations

import csv
import tempfile
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from flexmotion.configs.errors import ConfigError
from flexmotion.dataset.captions import COLUMNS
from flexmotion.dataset.clips import find_clips
from flexmotion.dataset.gestures.bases import Base, draw_base, extended, find_bases
from flexmotion.dataset.gestures.clearance import clearance
from flexmotion.dataset.gestures.overlay import overlaid
from flexmotion.gestures.plan import Plan, draw_plan
from flexmotion.gestures.recipes import Gesture, Ground
from flexmotion.human.joint_limits import joint_limits
from flexmotion.human.motion import Motion
from flexmotion.human.motion_file import save_motion
from flexmotion.human.skeleton import LEFT
from flexmotion.text.sides import mirrored

INDEX = "gestures_index.csv"
CAPTIONS = "gestures_captions.csv"
INDEX_COLUMNS = ("file", "split", "content", "style", "start_s", "left_s", "end_s", "around", "base")

TRIES = 8
"""Draws for one motion, until one keeps clear of the body and fits its base."""

WALKING = 0.25
"""Share of the motions over walking, of gestures that are made over it."""

VALIDATION_EVERY = 8
"""Every so many motions of a kind one is over a base of the validation split."""

TOUCH, CLEAR = -0.025, -0.005
"""Least distance of hands and forearms to the body, of gestures that touch it and of others [m]. A fitted base may be
nearer by itself."""

TIMES = {1: "once", 2: "twice", 3: "three times", 4: "four times", 5: "five times", 6: "six times"}


@dataclass(frozen=True)
class GestureMotion:
    """A gesture over a base, as it is written.

    Attributes:
        name: of the file, without suffix.
        kind: its label.
        motion: the human.
        base: what it was laid over.
        start, end: of the gesture in the motion [s].
        left: when its last pose is left [s].
        captions: sentences about it.
    """

    name: str
    kind: str
    motion: Motion
    base: Base
    start: float
    left: float
    end: float
    captions: tuple[str, ...]


def make_gestures(
    folders: Sequence[Path],
    out: Path,
    gestures: Sequence[Gesture],
    *,
    count: int,
    seed: int = 0,
    fps: float = 30.0,
    limit: int | None = None,
    progress: Callable[[float], None] = lambda done: None,
) -> dict[str, int]:
    """Write motions of every gesture, one file each, in folders by the collection of their base.

    Args:
        folders: of recordings, see `clips.find_clips`.
        out: folder of the motions, empty or new.
        gestures: that are made.
        count: of motions for each gesture; half of them to each side.
        seed: of all draws.
        fps: frame rate.
        limit: greatest number of recordings that are read, spread over all.
        progress: called with the share done, 0 to 1.

    Returns:
        Number of motions by kind.

    Raises:
        ConfigError: the folder is not empty, or no recording has a base.
        MotionFormatError: a folder or an archive cannot be read.
    """
    if out.exists() and (not out.is_dir() or any(out.iterdir())):
        raise ConfigError(f"{out}: exists and is not empty")
    with tempfile.TemporaryDirectory() as work:
        clips = [clip for clip in find_clips(folders, Path(work)) if clip.labels.get("style", "normal") == "normal"]
        if limit is not None and limit < len(clips):
            clips = [clips[number * len(clips) // limit] for number in range(limit)]
        bases: list[Base] = []
        for number, clip in enumerate(clips):
            bases += find_bases([clip], fps)
            progress(0.5 * (number + 1) / len(clips))
    if not any(base.ground == "stand" for base in bases):
        raise ConfigError(
            f"{', '.join(map(str, folders))}: no recording of normal style in which somebody stands quietly"
        )
    out.mkdir(parents=True, exist_ok=True)
    made: Counter[str] = Counter()
    rows, captions = [], []
    for place, gesture in enumerate(gestures):
        for found in motions_of(gesture, bases, count, seed):
            folder = out / found.base.clip.collection
            folder.mkdir(exist_ok=True)
            save_motion(found.motion, folder / f"{found.name}.npz")
            rows.append(_row(found))
            captions += [(found.name, _time(found.start), _time(found.end), text, "gesture") for text in found.captions]
            made[found.kind] += 1
        progress(0.5 + 0.5 * (place + 1) / len(gestures))
    _write(out / INDEX, INDEX_COLUMNS, rows)
    _write(out / CAPTIONS, COLUMNS, captions)
    return dict(made)


def motions_of(gesture: Gesture, bases: Sequence[Base], count: int, seed: int) -> Iterator[GestureMotion]:
    """Motions of one gesture, to the left and to the right in turn; those that never keep clear are left out.

    Args:
        gesture: the recipe.
        bases: recordings; at least one stands.
        count: of motions.
        seed: of all draws.
    """
    rng = np.random.default_rng([seed, *gesture.kind.encode()])
    for number in range(count):
        ground: Ground = "walk" if "walk" in gesture.over and rng.random() < WALKING else "stand"
        fitting = _fitting(bases, ground, number % VALIDATION_EVERY == VALIDATION_EVERY - 1)
        for _ in range(TRIES):
            base = draw_base(fitting, rng)
            found = gesture_over(gesture, base, number % 2, rng)
            if found is not None:
                yield _described(gesture, *found, base, number)
                break


def _fitting(bases: Sequence[Base], ground: Ground, held_out: bool) -> list[Base]:
    """Bases of a ground and a split; of another split, then of standing, where there are none."""
    on_ground = [base for base in bases if base.ground == ground]
    if not on_ground:
        return _fitting(bases, "stand", held_out)
    return [base for base in on_ground if (base.clip.split == "validation") == held_out] or on_ground


def gesture_over(gesture: Gesture, base: Base, side: int, rng: np.random.Generator) -> tuple[Motion, Plan] | None:
    """Draw a gesture over a base; None where it does not fit base, joints or body.

    Args:
        gesture: the recipe.
        base: stretch of a recording.
        side: of the gesture, `LEFT` or `RIGHT`.
        rng: random generator.
    """
    plan = draw_plan(gesture, base.motion.body, side, rng)
    before = extended(base, int(np.ceil(plan.duration * base.motion.fps)) + 1, rng)
    if before is None:
        return None
    motion = overlaid(before, plan, rng)
    lowest, highest = joint_limits().T
    if (np.minimum(motion.joints - lowest, highest - motion.joints) < -1e-9).any():
        return None
    frames = slice(int(max(plan.start, 0.0) * motion.fps), int(plan.end * motion.fps) + 1)
    least = TOUCH if gesture.touch else CLEAR
    if clearance(motion, frames) < min(least, clearance(before) - 0.005):
        return None
    return motion, plan


def _described(gesture: Gesture, motion: Motion, plan: Plan, base: Base, number: int) -> GestureMotion:
    kind = gesture.kind if base.ground == "stand" else f"walk-{gesture.kind}"
    times = TIMES.get(plan.repeats, f"{plan.repeats} times")
    captions = [text.replace("{times}", times) for text in gesture.captions]
    if base.ground == "walk":
        captions = [f"{text} while walking" for text in captions]
    if plan.side == LEFT:
        kind, captions = mirrored(kind), [mirrored(text) for text in captions]
    name = f"gesture_{kind}_{base.clip.name}_{number:03d}"
    motion = replace(motion, source=f"{gesture.kind} over {base.clip.name}")
    return GestureMotion(name, kind, motion, base, max(plan.start, 0.0), plan.left, plan.end, tuple(captions))


def _row(found: GestureMotion) -> tuple[str, ...]:
    clip = found.base.clip
    return (
        f"{found.name}.npz",
        clip.split,
        found.kind,
        "normal",
        _time(found.start),
        _time(found.left),
        _time(found.end),
        found.base.ground,
        clip.name,
    )


def _time(seconds: float) -> str:
    return f"{seconds:.3f}"


def _write(path: Path, columns: Sequence[str], rows: Iterable[Sequence[str]]) -> None:
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(columns)
        writer.writerows(rows)
