"""Windows of a feature store, drawn by seed and step so that a resumed training sees what an unbroken one would."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import torch
from torch import Tensor

from flexmotion.configs.errors import MotionFormatError
from flexmotion.configs.model import Window
from flexmotion.spatial.transitions import smoothstep
from flexmotion.training.feature_store import FeatureStore, StoredClip
from flexmotion.training.human_tensors import HumanTensors

EVENNESS = 0.75
"""0: kinds are drawn as often as they occur, 1: all equally often."""

CLIP = 15.0
"""Normalised features are held within this many spreads."""


@dataclass(frozen=True)
class Windows:
    """N windows of normalised features.

    Attributes:
        history: (N, H, F).
        future: (N, W, F).
        following: the W frames after it, (N, W, F); None where not asked for.
        mask: which frames of the future are of the clip and not held at its end, (N, W).
        clip: index into the store's clips, (N,).
        first: frame of the clip that the future begins with, (N,).
        branches: (N, H + W, 6), see `newton_euler.generalised_forces`.
        good: whether the ground explains the clip's motion, (N, H + W).
    """

    history: Tensor
    future: Tensor
    following: Tensor | None
    mask: Tensor
    clip: np.ndarray
    first: np.ndarray
    branches: Tensor
    good: Tensor

    def to(self, device: torch.device) -> Windows:
        """On another device."""
        moved = self._each(lambda tensor: tensor.to(device))
        return Windows(clip=self.clip, first=self.first, **moved)

    def first_of(self, count: int) -> Windows:
        """The first `count` of them."""
        cut = self._each(lambda tensor: tensor[:count])
        return Windows(clip=self.clip[:count], first=self.first[:count], **cut)

    def every(self, step: int) -> Windows:
        """Every `step`-th of them."""
        return Windows(clip=self.clip[::step], first=self.first[::step], **self._each(lambda tensor: tensor[::step]))

    def with_history(self, history: Tensor) -> Windows:
        """The same futures after other histories."""
        return replace(self, history=history)

    def moved_on(self, history: Tensor) -> Windows:
        """The windows after them, after another history, (N, H, F).

        Raises:
            ValueError: they were not drawn with what follows.
        """
        if self.following is None:
            raise ValueError("expected windows that were drawn with what follows them")
        # Of the ground's share in what follows nothing was drawn.
        return replace(
            self,
            history=history,
            future=self.following,
            following=None,
            first=self.first + self.future.shape[1],
            mask=torch.ones_like(self.mask),
            good=torch.zeros_like(self.good),
        )

    def going_over_to(self, others: Windows, frames: int) -> Windows:
        """The clips of `others`, after these histories, whose motion gives way to theirs over `frames` frames."""
        passed = np.arange(1, self.future.shape[1] + 1, dtype=np.float64)
        share = self.future.new_tensor(smoothstep(passed, 0.0, frames + 1.0))[:, None]
        return replace(
            others,
            history=self.history,
            future=self.future + share * (others.future - self.future),
            mask=self.mask & others.mask,
            good=torch.zeros_like(others.good),  # no ground explains a motion that is mixed
        )

    def with_others(self, others: Windows) -> Windows:
        """These, then others, both without what follows."""
        both = {
            name: torch.cat([getattr(self, name), getattr(others, name)])
            for name in ("history", "future", "mask", "branches", "good")
        }
        clip, first = np.concatenate([self.clip, others.clip]), np.concatenate([self.first, others.first])
        return Windows(clip=clip, first=first, following=None, **both)

    def _each(self, function: Callable[[Tensor], Tensor]) -> dict[str, Any]:
        names = ("history", "future", "following", "mask", "branches", "good")
        values = {name: getattr(self, name) for name in names}
        return {name: None if value is None else function(value) for name, value in values.items()}


class WindowSet:
    """All windows of one split.

    Clips are drawn by their number of windows over a power of their kind's share: rare kinds more often than they
    occur, but not as often as common ones.

    Args:
        store: features of a set.
        window: sizes.
        split: `train` or `validation`.

    Raises:
        MotionFormatError: no clip of the split is long enough.
    """

    def __init__(self, store: FeatureStore, window: Window, split: str) -> None:
        self.store, self.window, self.split = store, window, split
        length = window.history + window.future
        chosen = [
            number
            for number, clip in enumerate(store.clips)
            if clip.split == split and (window.padded or clip.frames >= length)
        ]
        if not chosen:
            raise MotionFormatError(f"{store.folder}: no clip of split {split!r} has the {length} frames of a window")
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

    @property
    def goes_on(self) -> bool:
        """Whether any clip has two windows in a row."""
        return bool((self._count > self.window.future).any())

    @cached_property
    def humans(self) -> HumanTensors:
        """The humans of all clips of the store."""
        return HumanTensors.of([clip.body for clip in self.store.clips])

    def draw(self, seed: tuple[int, ...], size: int, *, following: bool = False) -> Windows:
        """`size` windows.

        Args:
            seed: of what is drawn.
            size: how many.
            following: with the windows after them, of clips that go on for so long.

        Raises:
            MotionFormatError: no clip goes on for so long.
        """
        count = np.maximum(self._count - self.window.future, 0) if following else self._count
        weights = count * self._rarity
        if not weights.any():
            raise MotionFormatError(f"{self.store.folder}: no clip of split {self.split!r} has two windows in a row")
        rng = np.random.default_rng(seed)
        chosen = rng.choice(len(self.clips), size, p=weights / weights.sum())
        offset = rng.integers(0, count[chosen])
        return self.at(chosen, offset, following=following)

    def at(self, chosen: np.ndarray, offset: np.ndarray, *, following: bool = False) -> Windows:
        """Windows that begin (with their history) at these frames of these clips of the split."""
        window = self.window
        length = window.history + window.future
        span = length + (window.future if following else 0)
        frame = offset[:, None] + np.arange(span)
        last = self._frames[chosen][:, None] - 1
        rows = self._start[chosen][:, None] + np.minimum(frame, last)
        statistics = self.store.statistics
        values = torch.from_numpy(statistics.normalise(self.store.features[rows].astype(np.float32)))
        # A mistracked marker must not weigh as much as a thousand frames.
        values = values.clamp(-CLIP, CLIP)
        inside = torch.from_numpy(frame <= last)
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
        )

    def _held(self, values: Tensor, inside: Tensor) -> Tensor:
        """Beyond a clip's end its last pose without speed."""
        layout, statistics = self.store.layout, self.store.statistics
        still = torch.from_numpy(statistics.normalise(np.zeros(layout.size, np.float32)))
        moving = torch.zeros(layout.size, dtype=torch.bool)
        moving[layout.blocks["root"]] = torch.tensor([True, True, True, False])
        for name in ("velocities", "accelerations"):
            moving[layout.blocks[name]] = True
        return torch.where(~inside[..., None] & moving, still, values)


def kind(clip: StoredClip) -> str:
    """What a clip shows, by its labels."""
    return clip.labels.get("content") or clip.labels.get("action") or "unlabelled"
