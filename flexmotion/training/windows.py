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

from configs.errors import MotionFormatError
from configs.model import Window
from flexmotion.training.feature_store import FeatureStore, StoredClip
from flexmotion.training.human_tensors import HumanTensors

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

    def with_history(self, history: Tensor) -> Windows:
        """The same futures after other histories."""
        return replace(self, history=history)

    def replaced(self, history: Tensor, future: Tensor) -> Windows:
        """The first windows replaced by others, (n, H, F) and (n, W, F); of those no frame is held or unexplained."""
        count = len(history)
        return replace(
            self,
            history=torch.cat([history, self.history[count:]]),
            future=torch.cat([future, self.future[count:]]),
        )

    def _each(self, function: Callable[[Tensor], Tensor]) -> dict[str, Any]:
        names = ("history", "future", "following", "mask", "branches", "good")
        values = {name: getattr(self, name) for name in names}
        return {name: None if value is None else function(value) for name, value in values.items()}


class WindowSet:
    """All windows of one split.

    Clips are drawn by their number of windows over the square root of their kind's share: rare kinds more often than
    they occur, but not as often as common ones.

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
        weights = self._count / np.sqrt([share[name] for name in kinds])
        self._weights = weights / weights.sum()

    @cached_property
    def humans(self) -> HumanTensors:
        """The humans of all clips of the store."""
        return HumanTensors.of([clip.body for clip in self.store.clips])

    def draw(self, seed: tuple[int, ...], size: int, *, following: bool = False) -> Windows:
        """`size` windows.

        Args:
            seed: of what is drawn.
            size: how many.
            following: with the windows after them, where the clips go on; clips that do not are held at their end.
        """
        rng = np.random.default_rng(seed)
        chosen = rng.choice(len(self.clips), size, p=self._weights)
        offset = rng.integers(0, self._count[chosen])
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
