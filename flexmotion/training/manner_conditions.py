"""`Manners`: the manner of every clip, as the denoiser is given it: a mixture of its wordings' embeddings."""

from __future__ import annotations

from collections.abc import Callable, Iterable

import numpy as np
import torch
from torch import Tensor

from flexmotion.dataset.meaning import clip_manner
from flexmotion.text.manners import manner_wordings
from flexmotion.training.feature_store import StoredClip

NONE = -1


class Manners:
    """Manners of a store's clips, their wordings embedded once.

    Args:
        clips: of the store.
        encode: sentence to embedding.
        personal: wordings of a personal manner, which all clips then have; none: the manner of each clip's source.

    Attributes:
        names: manners that at least one clip shows, in order.
        personal: whether the manner is a personal one.
        of_clip: index of each clip's manner in `names`, (clips,); `NONE` where it is unknown.
    """

    def __init__(
        self, clips: Iterable[StoredClip], encode: Callable[[str], np.ndarray], personal: tuple[str, ...] = ()
    ) -> None:
        self.personal = bool(personal)
        found = [personal[0] if personal else clip_manner(clip.labels, clip.whole_captions) for clip in clips]
        self.names = tuple(sorted({name for name in found if name is not None}))
        number = {name: at for at, name in enumerate(self.names)}
        self.of_clip = np.array([NONE if name is None else number[name] for name in found], np.intp)
        said = [personal or manner_wordings(name) for name in self.names]
        self._wordings = [np.stack([encode(wording) for wording in own]).astype(np.float32) for own in said]

    @property
    def means(self) -> Tensor:
        """Mean embedding of each manner's wordings, of unit length, (names, D)."""
        return torch.from_numpy(np.stack([_unit(own.mean(axis=0)) for own in self._wordings]))

    def draw(self, rng: np.random.Generator, clips: np.ndarray, width: int) -> tuple[np.ndarray, Tensor]:
        """Manner of each window, (N,), `NONE` where it is unknown, and a random mixture of its wordings, (N, width).

        A request is given the mean of a manner's wordings, of which mixtures lie on every side.

        Args:
            rng: random generator.
            clips: clips of the windows, (N,).
            width: of the embeddings.
        """
        rows = self.of_clip[clips]
        mixtures = np.zeros((len(rows), width), np.float32)
        for at, row in enumerate(rows):
            if row != NONE:
                own = self._wordings[row]
                mixtures[at] = _unit(rng.dirichlet(np.ones(len(own))) @ own)
        return rows, torch.from_numpy(mixtures)


def mean_embedding(said: Iterable[str], encode: Callable[[str], np.ndarray]) -> np.ndarray:
    """Mean embedding of the wordings of a kind or a manner, of unit length, (D,)."""
    return _unit(np.mean([encode(wording) for wording in said], axis=0))


def _unit(vector: np.ndarray) -> np.ndarray:
    found: np.ndarray = (vector / np.linalg.norm(vector)).astype(np.float32)
    return found
