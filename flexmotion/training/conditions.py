"""What a window is told to be: sentence and velocity, from its clip's labels and from its own motion."""

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
"""A window whose points move less on average stands still, whatever its clip is called [leg/s]."""

STRAIGHT = 0.15
"""A window of a turn that turns less only walks [rad/s]."""

WALKING = 0.3
"""From this speed on it does [leg/s]."""

UNSTYLED = 0.6
"""Share of sentences that say nothing of the style."""

NONE = -1


@dataclass(frozen=True)
class Conditions:
    """What N windows are told.

    Attributes:
        row: of the sentence among `Sentences.texts`, (N,); `NONE` for none.
        sentence: embeddings, (N, D).
        velocity: (N, 3) [leg/s, rad/s].
        present: which of the two are told, (N, 2), 1 or 0.
    """

    row: np.ndarray
    sentence: Tensor
    velocity: Tensor
    present: Tensor

    def to(self, device: torch.device) -> Conditions:
        """On another device."""
        return Conditions(self.row, self.sentence.to(device), self.velocity.to(device), self.present.to(device))

    def untold(self) -> Conditions:
        """The same with neither sentence nor velocity: what guidance leads away from."""
        return replace(self, present=torch.zeros_like(self.present))


class Sentences:
    """Every sentence that a clip may be told with, embedded once.

    Args:
        clips: of the store.
        encode: sentence to embedding.
        manner: what is said behind every sentence of motion that a clip shows.

    Raises:
        ConfigError: nothing is known of any clip, so there is nothing to learn of sentences.
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
                plain = [f"{said} {manner}".strip() for said in (*wordings(kind), *captions)] or [manner] * bool(manner)
                cache[key] = self._rows(plain), self._rows(said for text in plain for said in styled(text, style))
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
        """A sentence for each window, (N,); `NONE` where nothing is known.

        Args:
            rng: source of randomness.
            clips: of the windows, (N,).
            still: whether they stand, (N,).
            straight: whether they walk without turning, (N,).
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
    """Label of what a clip shows; of a mirror image, of what that shows."""
    label = clip.labels.get("content") or clip.labels.get("action") or ""
    return mirrored(label) if clip.variant == "mirror" else label


def clip_captions(clip: StoredClip) -> tuple[str, ...]:
    """Sentences that its source has about a clip."""
    return tuple(mirrored(text) for text in clip.captions) if clip.variant == "mirror" else clip.captions


def mean_velocity(features: Tensor, layout: Layout) -> Tensor:
    """Velocity of the root over windows that are not normalised, seen from the frame before, (N, 3) [leg/s, rad/s]."""
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
        store: that they come from.
        sentences: of its clips.
        future: their features, not normalised, (N, W, F).
        clips: of the windows, (N,).
        seed: of what is drawn.
        drop: share of windows without sentence, without velocity.
    """
    rng = np.random.default_rng(seed)
    velocity = mean_velocity(future, store.layout)
    moving = future[..., store.layout.blocks["velocities"]].unflatten(-1, (-1, 3)).norm(dim=-1).mean(dim=(1, 2))
    walking = velocity[:, :2].norm(dim=-1) > WALKING
    straight = (walking & (velocity[:, 2].abs() < STRAIGHT)).numpy()
    rows = sentences.draw(rng, clips, (moving < STILL).numpy(), straight)
    said = (rows != NONE) & (rng.random(len(rows)) >= drop[0])
    moved = rng.random(len(rows)) >= drop[1]
    return Conditions(
        row=rows,
        sentence=sentences.embeddings[torch.from_numpy(np.maximum(rows, 0))],
        velocity=velocity,
        present=torch.from_numpy(np.stack([said, moved], axis=1).astype(np.float32)),
    )
