"""`FeatureStore`: the features of a whole set, computed once and memory-mapped from then on."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Callable, Iterator
from copy import copy
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from flexmotion.configs.errors import MotionFormatError
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

INDEX = "index.json"

RECORDED = ("original", "mirror")
"""Variants of a clip that were recorded; the others are made from it by augmentation."""

TRAINING = "train"
"""The split that a model learns from."""

CONTENT = 2
"""Increased when a store of the same set holds more; 2: with external loads and error estimates."""


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
    source: MotionSet, layout: Layout, folder: Path, progress: Callable[[float], None] = lambda done: None
) -> FeatureStore:
    """Compute the features of a set, or open those already computed from the same set and layout.

    Args:
        source: set of clips.
        layout: of the features.
        folder: of the store.
        progress: called with the share done, 0 to 1.

    Raises:
        MotionFormatError: the set has no clip to train on, or lacks a field, muscles or joint contact forces that the
            layout has.
    """
    if not any(clip.split == TRAINING for clip in source.clips):
        raise MotionFormatError(
            f"no clip of this set is in the split {TRAINING!r}, but in {_splits(source)}; give the clips to train on"
            f" {TRAINING!r} in the column 'split' of their index, and build the set anew"
        )
    key = _key(source, layout)
    index = folder / INDEX
    if index.is_file() and json.loads(index.read_text(encoding="utf-8"))["key"] == key:
        return FeatureStore(folder)
    folder.mkdir(parents=True, exist_ok=True)
    index.unlink(missing_ok=True)
    counts = [_frames(clip, layout.fps) for clip in source.clips]
    total = sum(counts)
    features = np.lib.format.open_memmap(
        folder / "features.npy", mode="w+", dtype=np.float16, shape=(total, layout.size)
    )
    beside = {
        "branches": np.empty((total, len(BALL_COLUMNS)), np.int8),
        "good": np.empty(total, np.bool_),
        "loads": np.empty((total, LOADS, 3), np.float16),
        "force_error": np.empty(total, np.float16),
    }
    clips, start = [], 0
    for clip, count in zip(source.clips, counts, strict=True):
        rows = slice(start, start + count)
        features[rows], found = _of_clip(source, clip, layout)
        for name, values in found.items():
            beside[name][rows] = values
        clips.append(
            {
                "name": clip.name,
                "start": start,
                "frames": count,
                "split": clip.split,
                "variant": clip.variant,
                "labels": clip.info["labels"],
                "captions": [caption["text"] for caption in clip.info["captions"]],
                "spans": [_span(caption, count / layout.fps) for caption in clip.info["captions"]],
                "body": clip.info["body"],
            }
        )
        start += count
        progress(start / total)
    features.flush()
    for name, values in beside.items():
        np.save(folder / f"{name}.npy", values)
    statistics = Statistics.of(_training_sample(features, clips), layout)
    np.savez(folder / "statistics.npz", mean=statistics.mean, spread=statistics.spread)
    content = {
        "format": FORMAT,
        "key": key,
        "fps": layout.fps,
        "muscles": layout.muscles,
        "joint_contact": layout.joint_contact,
        "licences": sorted({clip.info["licence"] for clip in source.clips if clip.info["licence"]}),
        "clips": clips,
    }
    temporary = index.with_suffix(".tmp")
    temporary.write_text(json.dumps(content), encoding="utf-8")
    os.replace(temporary, index)
    return FeatureStore(folder)


def _splits(source: MotionSet) -> str:
    return " and ".join(sorted({repr(clip.split) for clip in source.clips})) or "none"


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
        frames = np.arange(_frames(clip, layout.fps)) * motion.fps / layout.fps
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


def _frames(clip: SetClip, fps: float) -> int:
    """Number of frames of a clip at another rate, as `resample` gives."""
    if same_rate(clip.fps, fps):
        return clip.frames
    return len(resample_signal(np.zeros(clip.frames), clip.fps, fps))


def _training_sample(features: np.ndarray, clips: list[dict[str, Any]]) -> np.ndarray:
    """Every fourth frame of the training clips."""
    return np.concatenate([np.asarray(part, np.float32) for part in _parts(features, clips)])


def _parts(features: np.ndarray, clips: list[dict[str, Any]]) -> Iterator[np.ndarray]:
    for clip in clips:
        if clip["split"] == TRAINING:
            yield features[clip["start"] : clip["start"] + clip["frames"] : 4]


def _key(source: MotionSet, layout: Layout) -> str:
    content = json.dumps([source.hashes, layout.hash, CONTENT], sort_keys=True)
    return hashlib.sha256(content.encode()).hexdigest()


def _body(row: dict[str, Any]) -> Body:
    fitted = row["fitted"]
    return Body(**{**row, "fitted": Segments(**fitted) if fitted else None})


def _captions(item: dict[str, Any]) -> dict[str, Any]:
    spans = tuple((start, end) for start, end in item.get("spans", ()))
    return {"captions": tuple(item["captions"]), "spans": spans}


WHOLE_S = 1.0
"""A caption that begins and ends this near to its clip's start and end is one of the whole clip [s]."""


def _span(caption: dict[str, Any], seconds: float) -> tuple[float, float]:
    """Start and end of a caption [s]; zeros where it is one of the whole clip."""
    start, end = float(caption["start"]), float(caption["end"])
    whole = not end or (start <= WHOLE_S and end >= seconds - WHOLE_S)
    return (0.0, 0.0) if whole else (start, end)
