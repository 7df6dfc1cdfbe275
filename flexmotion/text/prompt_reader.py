"""`PromptReader`: what is asked for in words, as the model has learnt to hear it."""

from __future__ import annotations

import logging
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from flexmotion.text.phrases import STAND
from flexmotion.text.sentence_encoder import SentenceEncoder

log = logging.getLogger(__name__)

NEAREST = 8
SAME = 0.99
"""Cosine from which on two wordings are one."""

SHARPNESS = 40.0
"""The nearest known wordings count by the exponential of so many times their cosine."""


@dataclass(frozen=True)
class Prompt:
    """A sentence read.

    Attributes:
        embedding: as the denoiser takes it, (D,), of unit length.
        kind: of motion that it means.
        likeness: cosine with the known wording nearest to it.
        known: whether it means something.
    """

    embedding: NDArray[np.float32]
    kind: str
    likeness: float
    known: bool


class PromptReader:
    """Reads sentences by the wordings that a model was trained with.

    A sentence is heard as a mixture of the known wordings nearest to it, so that an unseen wording lands where the
    model has been; only of those of one kind, on which they vote: "to your left" is nearly as near to "turn right" as
    to "turn left", and half of each is neither. A known wording needs no vote. What is like none means standing still.

    Args:
        folder: of the sentence encoder.
        kinds: of motion that the wordings mean, (K,).
        embeddings: of the wordings, (K, D).
        least: likeness below which a sentence means nothing.
    """

    def __init__(self, folder: Path, kinds: tuple[str, ...], embeddings: NDArray[np.float32], least: float) -> None:
        self._encode = SentenceEncoder(folder)
        self._kinds, self._embeddings, self._least = np.array(kinds), embeddings, least
        standing = embeddings[self._kinds == STAND].mean(axis=0)
        self.idle = Prompt(_unit(standing), STAND, 1.0, True)

    def __call__(self, sentence: str) -> Prompt:
        """What a sentence means; warns where it means nothing."""
        likeness = self._embeddings @ self._encode(sentence)
        near = np.argsort(-likeness, kind="stable")[:NEAREST]
        best = float(likeness[near[0]])
        if best < self._least:
            log.warning("%r means nothing to this model: it stands still", sentence)
            return Prompt(self.idle.embedding, STAND, best, False)
        weight = np.exp(SHARPNESS * (likeness[near] - best))
        kinds = self._kinds[near]
        votes = 1 if best > SAME else NEAREST
        kind = max(dict.fromkeys(kinds[:votes]), key=lambda name: weight[kinds == name].sum())
        weight[kinds != kind] = 0.0
        return Prompt(_unit(weight @ self._embeddings[near]), str(kind), best, True)


def _unit(vector: NDArray[np.float32]) -> NDArray[np.float32]:
    return (vector / np.linalg.norm(vector)).astype(np.float32)
