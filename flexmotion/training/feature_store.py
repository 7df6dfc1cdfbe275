"""`FeatureStore`: the features of a whole set, computed once and memory-mapped from then on."""

from __future__ import annotations

import json
import logging
import os
from collections.abc import Callable, Iterator
from copy import copy
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from flexmotion.configs.errors import ConfigError, MotionFormatError
from flexmotion.dataset.compact_set import MotionSet
from flexmotion.dataset.meaning import clip_kind, shown
from flexmotion.dataset.training_set import SetClip
from flexmotion.features.encode import encode, encode_loads
from flexmotion.features.joint_groups import BALL_COLUMNS
from flexmotion.features.layout import Layout
from flexmotion.features.slope import levelled
from flexmotion.features.statistics import Statistics
from flexmotion.human.body import Body, Segments
from flexmotion.human.resample import resample
from flexmotion.human.signals import resample_signal, same_rate
from flexmotion.spatial.gravity import GRAVITY
from flexmotion.training.format import FEATURES_VERSIONS, FORMAT, UNVERSIONED
from flexmotion.training.human_tensors import LOADS
from flexmotion.training.onsets import TOLD_BY, WITHIN_S, onset
from flexmotion.training.store_index import (
    INDEX,
    Entry,
    changes,
    clip_entries,
    is_of,
    key_of,
    licences_of,
    stored_frames,
)

log = logging.getLogger(__name__)

RECORDED = ("original", "mirror")
"""Variants of a clip that were recorded; the others are made from it by augmentation."""

TRAINING = "train"
"""The split that a model learns from."""

HELD_OUT = "validation"
"""The split that a training is validated on."""


@dataclass(frozen=True)
class StoredClip:
    """A clip in the store: its rows, and its description in the set.

    Attributes:
        name: of the clip.
        start, frames: first row and number of rows.
        split: `train` or `validation`.
        variant: `original`, `mirror`, or the name of an augmentation.
        labels, captions: of its source.
        spans: start and end of each caption [s]; an end of 0 is the clip's. None in stores of earlier releases: whole.
        body: size and proportions of the human.
    """

    name: str
    start: int
    frames: int
    split: str
    variant: str
    labels: dict[str, str]
    captions: tuple[str, ...]
    body: Body
    spans: tuple[tuple[float, float], ...] = ()

    @property
    def whole_captions(self) -> tuple[str, ...]:
        """Captions of the whole clip."""
        return tuple(text for text, span in zip(self.captions, self._spans, strict=True) if not span[1])

    @property
    def partial_captions(self) -> tuple[tuple[str, float, float], ...]:
        """Captions of a part of the clip, with its start and end [s]."""
        return tuple((text, *span) for text, span in zip(self.captions, self._spans, strict=True) if span[1])

    @property
    def _spans(self) -> tuple[tuple[float, float], ...]:
        return self.spans or ((0.0, 0.0),) * len(self.captions)

    @property
    def recorded(self) -> bool:
        """Whether it is a recording or its mirror image, not a variant."""
        return self.variant in RECORDED


class FeatureStore:
    """Features of every frame of a set, in the order of its clips.

    Args:
        folder: that `build_store` wrote.

    Attributes:
        layout: of the features.
        features: half precision, not normalised, memory-mapped, (rows, F).
        branches: sign of the cosine of each ball joint's second angle, (rows, 6).
        good: frames whose motion the ground reaction explains, (rows,).
        loads: external forces, see `physics.external_wrenches`, (rows, LOADS, 3) [body weights].
        force_error: estimated standard error of the ground forces on both feet together, (rows,) [body weights].
        statistics: mean and standard deviation of the training clips' features.

    Raises:
        ConfigError: its format is too old or too new.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        index = json.loads((folder / INDEX).read_text(encoding="utf-8"))
        FEATURES_VERSIONS.check(index.get("format", UNVERSIONED), folder / INDEX)
        self.layout = Layout(index["fps"], index["muscles"], joint_contact=index.get("joint_contact", False))
        self._clips = index["clips"]
        self.features: np.ndarray = np.load(folder / "features.npy", mmap_mode="r")
        self.branches: np.ndarray = np.load(folder / "branches.npy")
        self.good: np.ndarray = np.load(folder / "good.npy")
        self.loads, self.force_error = self._optional("loads", (LOADS, 3)), self._optional("force_error", ())
        with np.load(folder / "statistics.npz") as found:
            self.statistics = Statistics(found["mean"], found["spread"])

    def _optional(self, name: str, shape: tuple[int, ...]) -> np.ndarray:
        """An array that stores of earlier formats lack: zeros, which need no memory."""
        path = self.folder / f"{name}.npy"
        zero = np.zeros((), np.float16)
        return np.load(path) if path.is_file() else np.broadcast_to(zero, (len(self.good), *shape))

    @cached_property
    def clips(self) -> tuple[StoredClip, ...]:
        """Every clip."""
        return tuple(StoredClip(**{**item, **_captions(item), "body": _body(item["body"])}) for item in self._clips)

    @cached_property
    def onsets(self) -> np.ndarray:
        """Frames in which clips begin to show their motion, (clips,): as their index says, else as they move."""
        block, found = self.layout.blocks["positions"], []
        for clip in self.clips:
            part = shown(clip.labels)
            if part is not None:
                found.append(round(part.start * self.layout.fps))
                continue
            frames = min(clip.frames, round(WITHIN_S * self.layout.fps))
            places = self.features[clip.start : clip.start + frames, block].astype(np.float32)
            told = TOLD_BY.get(clip_kind(clip.labels, clip.whole_captions), self.layout.points)
            chosen = [self.layout.points.index(point) for point in told]
            found.append(onset(places.reshape(len(places), -1, 3)[:, chosen]))
        return np.array(found, np.intp)

    def without_variants(self) -> FeatureStore:
        """The same store without variants in its training split."""
        other = copy(self)
        for cached in ("clips", "onsets"):
            vars(other).pop(cached, None)
        other._clips = [item for item in self._clips if item["variant"] in RECORDED or item["split"] != TRAINING]
        return other

    @cached_property
    def licences(self) -> tuple[str, ...]:
        """Licences of the collections in it."""
        return tuple(json.loads((self.folder / INDEX).read_text(encoding="utf-8"))["licences"])


def build_store(
    source: MotionSet,
    layout: Layout,
    folder: Path,
    progress: Callable[[float], None] = lambda done: None,
    *,
    begun: bool = False,
) -> FeatureStore:
    """Compute the features of a set, or open those already computed from the same motion and layout.

    Splits, labels and captions are always those of the set; what changed is logged.

    Args:
        source: set of clips.
        layout: of the features.
        folder: of the store.
        progress: called with the share done, 0 to 1.
        begun: whether weights were trained on the features that are there: they and their statistics stay.

    Raises:
        MotionFormatError: the set has no clip to train on, or lacks a field, muscles or joint contact forces that the
            layout has.
        ConfigError: weights were trained on the features of another set.
    """
    require_split(source, TRAINING, "to train on")
    index, key, entries = folder / INDEX, key_of(source, layout), clip_entries(source, layout)
    if index.is_file():
        there = json.loads(index.read_text(encoding="utf-8"))
        same = is_of(there, source, layout, entries)
        if begun and not same:
            before, now = _size(there.get("set", "another set"), there["clips"]), _size(source.name, entries)
            raise ConfigError(
                f"{folder}: the training there is on {before}, --set is {now}{' with other motion' * (before == now)};"
                " leave --set away to go on, or give another folder for a new training. To go on with these weights on"
                " another set, 'export --weights' and begin a new folder with --from"
            )
        if same and (begun or there["key"] == key):
            return _described(folder, there, source, entries, begun)
    folder.mkdir(parents=True, exist_ok=True)
    index.unlink(missing_ok=True)
    total = sum(entry["frames"] for entry in entries)
    features = np.lib.format.open_memmap(
        folder / "features.npy", mode="w+", dtype=np.float16, shape=(total, layout.size)
    )
    beside = {
        "branches": np.empty((total, len(BALL_COLUMNS)), np.int8),
        "good": np.empty(total, np.bool_),
        "loads": np.empty((total, LOADS, 3), np.float16),
        "force_error": np.empty(total, np.float16),
    }
    for clip, entry in zip(source.clips, entries, strict=True):
        rows = slice(entry["start"], entry["start"] + entry["frames"])
        features[rows], found = _of_clip(source, clip, layout)
        for name, values in found.items():
            beside[name][rows] = values
        progress(rows.stop / total)
    features.flush()
    for name, values in beside.items():
        np.save(folder / f"{name}.npy", values)
    _write_statistics(folder, features, entries, layout)
    content = {
        "format": FORMAT,
        "key": key,
        "set": source.name,
        "fps": layout.fps,
        "muscles": layout.muscles,
        "joint_contact": layout.joint_contact,
        "licences": licences_of(source),
        "clips": entries,
    }
    _write_index(index, content)
    return FeatureStore(folder)


def _described(
    folder: Path, there: dict[str, Any], source: MotionSet, entries: list[Entry], begun: bool
) -> FeatureStore:
    """The store of a folder, with its clips described as a set of the same motion describes them now."""
    store = FeatureStore(folder)
    if not (changed := changes(there["clips"], entries)):
        return store
    training = ([entry["name"] for entry in clips if entry["split"] == TRAINING] for clips in (there["clips"], entries))
    about, moved = "", next(training) != next(training)
    if begun and moved:
        about = "; the statistics stay, and figures of clips that were trained on before are too good"
    elif moved:
        _write_statistics(folder, store.features, entries, store.layout)
    _write_index(folder / INDEX, there | {"licences": licences_of(source), "clips": entries})
    log.warning("%s: %s changed in the set, and here%s", folder, changed, about)
    return FeatureStore(folder)


def _write_index(index: Path, content: dict[str, Any]) -> None:
    temporary = index.with_suffix(f".{os.getpid()}.tmp")
    temporary.write_text(json.dumps(content), encoding="utf-8")
    os.replace(temporary, index)


def _write_statistics(folder: Path, features: np.ndarray, clips: list[Entry], layout: Layout) -> None:
    statistics = Statistics.of(_training_sample(features, clips), layout)
    np.savez(folder / "statistics.npz", mean=statistics.mean, spread=statistics.spread)


def _size(name: str, entries: list[Entry]) -> str:
    return f"{name} ({len(entries)} clips, {sum(entry['frames'] for entry in entries)} frames)"


def require_split(source: MotionSet, split: str, purpose: str) -> None:
    """Raise `MotionFormatError` where no clip of a set is in a split; `purpose` says what those clips are for."""
    if any(clip.split == split for clip in source.clips):
        return
    there = " and ".join(sorted({repr(clip.split) for clip in source.clips})) or "none"
    raise MotionFormatError(
        f"no clip of this set is in the split {split!r}, but in {there}; give the clips {purpose}"
        f" {split!r} in the column 'split' of their index, and build the set anew"
    )


def _of_clip(source: MotionSet, clip: SetClip, layout: Layout) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Features of a clip, and the arrays beside them."""
    motion = source.motion(clip)
    if not layout.muscles:
        motion = replace(motion, activations=None)
    elif motion.activations is None:
        raise MotionFormatError(f"{clip.name}: this set has no muscle activations; set window.muscles to false")
    if layout.joint_contact and motion.joint_contact is None:
        raise MotionFormatError(
            f"{clip.name}: this set has no joint contact forces; build it with muscles, or set window.joint_contact to"
            " false"
        )
    good = source.good(clip)
    level = levelled(motion, source.centres(clip), source.loads(clip), clip.info.get("slope", (0.0, 0.0)))
    motion, centres = level.motion, level.centres
    weight = motion.body.mass * GRAVITY * level.gravity
    loads = np.concatenate([level.loads, np.broadcast_to(weight, (len(motion), 1, 3))], axis=1)
    error = np.linalg.norm(source.force_error(clip), axis=1).clip(0.0, float(np.finfo(np.float16).max))
    if not same_rate(motion.fps, layout.fps):
        frames = np.arange(stored_frames(clip, layout.fps)) * motion.fps / layout.fps
        nearest = np.minimum(np.round(frames).astype(int), len(motion) - 1)
        good, error = good[nearest], error[nearest]
        centres, loads = (resample_signal(values, motion.fps, layout.fps) for values in (centres, loads))
        motion = resample(motion, layout.fps)
    beside = {
        "branches": np.where(np.cos(motion.joints[:, BALL_COLUMNS[:, 1]]) < 0, -1, 1),
        "good": good,
        "loads": encode_loads(loads, motion),
        "force_error": error,
    }
    return encode(motion, layout, centres), beside


def _training_sample(features: np.ndarray, clips: list[Entry]) -> np.ndarray:
    """Every fourth frame of the training clips."""
    return np.concatenate([np.asarray(part, np.float32) for part in _parts(features, clips)])


def _parts(features: np.ndarray, clips: list[Entry]) -> Iterator[np.ndarray]:
    for clip in clips:
        if clip["split"] == TRAINING:
            yield features[clip["start"] : clip["start"] + clip["frames"] : 4]


def _body(row: dict[str, Any]) -> Body:
    fitted = row["fitted"]
    return Body(**{**row, "fitted": Segments(**fitted) if fitted else None})


def _captions(item: dict[str, Any]) -> dict[str, Any]:
    spans = tuple((start, end) for start, end in item.get("spans", ()))
    return {"captions": tuple(item["captions"]), "spans": spans}
