"""`WindowSet`: the windows of one split, drawn by seed and step, so that a resumed training draws the same ones."""

from __future__ import annotations

from collections import Counter
from functools import cached_property

import numpy as np
import torch
from torch import Tensor

from flexmotion.configs.errors import MotionFormatError
from flexmotion.configs.model import Window
from flexmotion.dataset.meaning import clip_manner
from flexmotion.text.manners import NORMAL
from flexmotion.training.feature_store import FeatureStore, StoredClip
from flexmotion.training.human_tensors import HumanTensors
from flexmotion.training.onsets import LATE_S
from flexmotion.training.windows import Windows

EVENNESS = 0.75
"""0: kinds of motion are drawn as often as they occur, 1: all equally often."""

MOST_NORMAL = 8.0
"""Greatest factor on the weight of a kind's normal clips: one clip must not be most of what is seen of a kind."""

BEGUN_S = 0.1
"""Windows at the beginning of a motion begin at most so long after it [s]."""

CLIP = 15.0
"""Normalised features are clipped to this many standard deviations."""


class WindowSet:
    """All windows of one split.

    The probability of a clip is its number of windows over a power of its kind's share: rare kinds are drawn more often
    than they occur, but less often than common ones. Variants of clips are for training: held-out figures are of
    recorded clips and their mirror images alone, and so comparable between sets with and without variants.

    Args:
        store: features of a set.
        window: sizes.
        split: `train` or `validation`.
        variants: whether windows are of variants too; None: in the split `train`.
        normal: least share of the normal manner among the windows of a kind that has normal clips.

    Raises:
        MotionFormatError: no clip of the split is long enough.
    """

    def __init__(
        self, store: FeatureStore, window: Window, split: str, *, variants: bool | None = None, normal: float = 0.0
    ) -> None:
        variants = split == "train" if variants is None else variants
        self.store, self.window, self.split = store, window, split
        length = window.history + window.future
        chosen = [
            number
            for number, clip in enumerate(store.clips)
            if clip.split == split and (variants or clip.recorded) and (window.padded or clip.frames >= length)
        ]
        if not chosen:
            raise MotionFormatError(
                f"{store.folder}: no clip of split {split!r} has the {length} frames of a window; give longer clips"
                f" {split!r} in the column 'split' of their index, and build the set anew"
            )
        self.clips = np.array(chosen)
        clips = [store.clips[number] for number in chosen]
        self._start = np.array([clip.start for clip in clips])
        self._frames = np.array([clip.frames for clip in clips])
        self._count = np.maximum(self._frames - length + 1, 1)
        kinds = [kind(clip) for clip in clips]
        share: Counter[str] = Counter()
        for name, count in zip(kinds, self._count, strict=True):
            share[name] += int(count)
        self._rarity = np.array([share[name] for name in kinds], np.float64) ** -EVENNESS
        if normal:
            plain = np.array([clip_manner(clip.labels, clip.whole_captions) == NORMAL for clip in clips])
            self._rarity *= normal_weights(np.array(kinds), plain, self._count, normal)

    @property
    def has_following(self) -> bool:
        """Whether any clip has two consecutive windows."""
        return bool((self._count > self.window.future).any())

    @cached_property
    def humans(self) -> HumanTensors:
        """Human models of all clips of the store."""
        return HumanTensors.of([clip.body for clip in self.store.clips])

    def draw(
        self, seed: tuple[int, ...], size: int, *, following: bool = False, begun: float = 0.0, known: bool = True
    ) -> Windows:
        """Draw windows at random.

        Args:
            seed: the same seed draws the same windows.
            size: number of windows.
            following: whether to draw the windows that follow too, from clips that are long enough.
            begun: share of windows that are moved to where the motion of their clip begins.
            known: whether the frames before these are needed; else they may begin with their clips.

        Raises:
            MotionFormatError: no clip has two consecutive windows.
        """
        count = np.maximum(self._count - self.window.future, 0) if following else self._count
        weights = count * self._rarity
        if not weights.any():
            raise MotionFormatError(f"{self.store.folder}: no clip of split {self.split!r} has two windows in a row")
        rng = np.random.default_rng(seed)
        chosen = rng.choice(len(self.clips), size, p=weights / weights.sum())
        offset = rng.integers(0, count[chosen])
        if begun:
            onset = self.store.onsets[self.clips[chosen]]
            early, late = (round(seconds * self.store.layout.fps) for seconds in (LATE_S, BEGUN_S))
            first = np.maximum(onset + rng.integers(-early, late + 1, size), 0) - self.window.history
            moved = (rng.random(size) < begun) & (first < count[chosen]) & ((first >= 0) | (not known))
            offset = np.where(moved, first, offset)
        return self.at(chosen, offset, following=following)

    def at(self, chosen: np.ndarray, offset: np.ndarray, *, following: bool = False) -> Windows:
        """Windows at given places.

        Args:
            chosen: clips, as numbers within the split, (N,).
            offset: frames of those clips at which the histories begin, (N,); before a clip its first frame is
                repeated.
            following: whether to take the windows that follow too.
        """
        window = self.window
        length = window.history + window.future
        span = length + (window.future if following else 0)
        frame = offset[:, None] + np.arange(span)
        last = self._frames[chosen][:, None] - 1
        rows = self._start[chosen][:, None] + np.clip(frame, 0, last)
        statistics = self.store.statistics
        values = torch.from_numpy(statistics.normalise(self.store.features[rows].astype(np.float32)))
        # A mistracked marker must not weigh as much as a thousand frames.
        values = values.clamp(-CLIP, CLIP)
        inside = torch.from_numpy((frame >= 0) & (frame <= last))
        if not bool(inside.all()):
            values = self._held(values, inside)
        return Windows(
            history=values[:, : window.history],
            future=values[:, window.history : length],
            following=values[:, length:] if following else None,
            mask=inside[:, window.history : length],
            clip=self.clips[chosen],
            first=offset + window.history,
            branches=torch.from_numpy(self.store.branches[rows[:, :length]].astype(np.float32)),
            good=torch.from_numpy(self.store.good[rows[:, :length]]) & inside[:, :length],
            loads=torch.from_numpy(self.store.loads[rows[:, :length]].astype(np.float32)),
            force_error=torch.from_numpy(self.store.force_error[rows[:, :length]].astype(np.float32)),
        )

    def _held(self, values: Tensor, inside: Tensor) -> Tensor:
        """Set speeds and accelerations to zero beyond a clip's end, where its last pose is repeated."""
        layout, statistics = self.store.layout, self.store.statistics
        still = torch.from_numpy(statistics.normalise(np.zeros(layout.size, np.float32)))
        moving = torch.zeros(layout.size, dtype=torch.bool)
        moving[layout.blocks["root"]] = torch.tensor([True, True, True, False])
        for name in ("velocities", "accelerations"):
            moving[layout.blocks[name]] = True
        return torch.where(~inside[..., None] & moving, still, values)


def normal_weights(kinds: np.ndarray, plain: np.ndarray, count: np.ndarray, least: float) -> np.ndarray:
    """Weights of clips, (N,), by which the normal ones are at least a share of their kind, whose total stays.

    Args:
        kinds: of motion, (N,).
        plain: whether a clip is of the normal manner, (N,).
        count: windows of each clip, (N,).
        least: share of the normal manner, in [0, 1); reached where `MOST_NORMAL` allows it.
    """
    weights = np.ones(len(kinds))
    for name in np.unique(kinds):
        own = kinds == name
        all_of, normal = count[own].sum(), count[own & plain].sum()
        if not 0 < normal < least * all_of:
            continue
        factor = min(least / (1 - least) * (all_of - normal) / normal, MOST_NORMAL)
        weights[own & plain] = factor
        weights[own] *= all_of / (all_of - normal + factor * normal)
    return weights


def kind(clip: StoredClip) -> str:
    """Kind of motion of a clip, by its labels."""
    return clip.labels.get("content") or clip.labels.get("action") or "unlabelled"
