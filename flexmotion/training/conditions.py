"""Conditions of a window: a sentence from its clip's labels, a velocity from its motion."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace

import numpy as np
import torch
from torch import Tensor

from flexmotion.configs.errors import ConfigError
from flexmotion.features.layout import Layout
from flexmotion.text.phrases import STAND, styled, wordings
from flexmotion.text.sides import mirrored
from flexmotion.training.feature_store import FeatureStore, StoredClip
from flexmotion.training.kinematics import path

STILL = 0.12
"""A window whose points move less on average counts as standing, whatever its clip's label [leg/s]."""

STRAIGHT = 0.15
"""A window of a turning clip that turns less counts as walking straight [rad/s]"""

WALKING = 0.3
"""Least speed of walking [leg/s]."""

UNSTYLED = 0.6
"""Share of sentences without the style."""

NONE = -1


@dataclass(frozen=True)
class Conditions:
    """Conditions of N windows.

    Attributes:
        row: index of the sentence in `Sentences.texts`, (N,); `NONE` for none.
        sentence: embeddings, (N, D).
        velocity: forward, left, turning, (N, 3) [leg/s, leg/s, rad/s].
        present: whether sentence and velocity are given, (N, 2), 1 or 0.
    """

    row: np.ndarray
    sentence: Tensor
    velocity: Tensor
    present: Tensor

    def to(self, device: torch.device) -> Conditions:
        """On another device."""
        return Conditions(self.row, self.sentence.to(device), self.velocity.to(device), self.present.to(device))

    def unconditional(self) -> Conditions:
        """The same with neither sentence nor velocity, for classifier-free guidance."""
        return replace(self, present=torch.zeros_like(self.present))


class Sentences:
    """Every sentence that may describe a clip, embedded once.

    Args:
        clips: of the store.
        encode: sentence to embedding.
        manner: words appended to every sentence of a clip.

    Raises:
        ConfigError: no clip has a caption or a known label, so there is no sentence to learn.
    """

    def __init__(self, clips: Iterable[StoredClip], encode: Callable[[str], np.ndarray], manner: str = "") -> None:
        self._number: dict[str, int] = {}
        cache: dict[tuple, tuple[np.ndarray, np.ndarray]] = {}
        self._plain: list[np.ndarray] = []
        self._styled: list[np.ndarray] = []
        self.kinds: list[str] = []
        for clip in clips:
            kind, style, captions = clip_kind(clip), clip.labels.get("style", ""), clip_captions(clip)
            key = (kind, style, captions)
            if key not in cache:
                plain = [f"{text} {manner}".strip() for text in (*wordings(kind), *captions)] or [manner] * bool(manner)
                cache[key] = self._rows(plain), self._rows(way for text in plain for way in styled(text, style))
            self._plain.append(cache[key][0])
            self._styled.append(cache[key][1])
            self.kinds.append(kind)
        if not any(map(len, self._plain)):
            raise ConfigError(
                "the set: no clip has a caption or a known label; put the collection's *_index.csv or *_captions.csv"
                " beside its files and build the set again (docs/biomechanics.md)"
            )
        self._of_kind = {kind: self._rows(wordings(kind)) for kind in (STAND, "walk")}
        self.embeddings = torch.from_numpy(np.stack([encode(text) for text in self._number])).float()

    def _rows(self, texts: Iterable[str]) -> np.ndarray:
        return np.array([self._number.setdefault(text, len(self._number)) for text in texts], np.intp)

    @property
    def texts(self) -> tuple[str, ...]:
        """Every sentence, in the order of `embeddings`."""
        return tuple(self._number)

    def draw(self, rng: np.random.Generator, clips: np.ndarray, still: np.ndarray, straight: np.ndarray) -> np.ndarray:
        """Row of a sentence for each window, (N,); `NONE` where its clip has no sentence.

        Args:
            rng: random generator.
            clips: clips of the windows, (N,).
            still: windows that stand, (N,).
            straight: windows that walk without turning, (N,).
        """
        rows = np.full(len(clips), NONE, np.intp)
        for at, clip in enumerate(clips):
            kind = self.kinds[clip]
            if still[at]:
                choice = self._of_kind[STAND]
            elif straight[at] and kind.startswith("walk-turn"):
                choice = self._of_kind["walk"]
            else:
                choice = (self._plain if rng.random() < UNSTYLED else self._styled)[clip]
            if len(choice):
                rows[at] = rng.choice(choice)
        return rows


def clip_kind(clip: StoredClip) -> str:
    """Label of a clip's motion; of a mirror image, with the sides exchanged."""
    label = clip.labels.get("content") or clip.labels.get("action") or ""
    return mirrored(label) if clip.variant == "mirror" else label


def clip_captions(clip: StoredClip) -> tuple[str, ...]:
    """Captions of a clip from its source; of a mirror image, with the sides exchanged."""
    return tuple(mirrored(text) for text in clip.captions) if clip.variant == "mirror" else clip.captions


def mean_velocity(features: Tensor, layout: Layout) -> Tensor:
    """Mean velocity of the root over windows (N, W, F), not normalised, (N, 3) [leg/s, leg/s, rad/s].

    Its axes are those of the body in the frame before the window.
    """
    place, yaw = path(features[..., layout.blocks["root"]], layout.fps)
    seconds = features.shape[1] / layout.fps
    return torch.cat([place[:, -1], yaw[:, -1:]], dim=-1) / seconds


def describe(
    store: FeatureStore,
    sentences: Sentences,
    future: Tensor,
    clips: np.ndarray,
    seed: tuple[int, ...],
    drop: tuple[float, float],
) -> Conditions:
    """Conditions of windows.

    Args:
        store: of the windows.
        sentences: of the store's clips.
        future: features, not normalised, (N, W, F).
        clips: clips of the windows, (N,).
        seed: of all draws.
        drop: share of windows without sentence, share without velocity.
    """
    rng = np.random.default_rng(seed)
    velocity = mean_velocity(future, store.layout)
    moving = future[..., store.layout.blocks["velocities"]].unflatten(-1, (-1, 3)).norm(dim=-1).mean(dim=(1, 2))
    walking = velocity[:, :2].norm(dim=-1) > WALKING
    straight = (walking & (velocity[:, 2].abs() < STRAIGHT)).numpy()
    rows = sentences.draw(rng, clips, (moving < STILL).numpy(), straight)
    has_sentence = (rows != NONE) & (rng.random(len(rows)) >= drop[0])
    has_velocity = rng.random(len(rows)) >= drop[1]
    return Conditions(
        row=rows,
        sentence=sentences.embeddings[torch.from_numpy(np.maximum(rows, 0))],
        velocity=velocity,
        present=torch.from_numpy(np.stack([has_sentence, has_velocity], axis=1).astype(np.float32)),
    )
