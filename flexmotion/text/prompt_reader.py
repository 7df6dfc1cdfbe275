"""`PromptReader`: what is asked for in words, as the model has learnt to hear it."""

from __future__ import annotations

import logging
import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from flexmotion.text.phrases import STAND
from flexmotion.text.sentence_encoder import SentenceEncoder

log = logging.getLogger(__name__)

SAME = 0.99
"""Cosine from which on two wordings are one."""

VOTERS, DECISION = 8, 40.0
"""The nearest known wordings vote by the exponential of so many times their cosine."""

BREADTH = 10.0
"""Those of the chosen kind are mixed likewise, more evenly: what many of them have in common is what it means."""


NEGATION = re.compile(r"\b(not|never|no|without|stop|quit|cease|avoid|halt)\b|n['’]t\b", re.IGNORECASE)
"""To a sentence encoder "do not walk" is nearly "do walk": who is told what not to do stands still."""


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

    The known wordings nearest to a sentence vote on the kind of motion; it is heard as a mixture of those of that kind,
    the nearer the more, so that an unseen wording lands where the model has been. Never as one of several kinds: "to
    your left" is nearly as near to "turn right" as to "turn left", and half of each is neither. A known wording needs
    no vote. What is like none means standing still, and so does what says what not to do.

    Args:
        folder: of the sentence encoder.
        kinds: of motion that the wordings mean, (K,).
        embeddings: of the wordings, (K, D).
        least: likeness below which a sentence means nothing.
    """

    def __init__(self, folder: Path, kinds: tuple[str, ...], embeddings: NDArray[np.float32], least: float) -> None:
        self._encode = SentenceEncoder(folder)
        self._kinds, self._embeddings, self._least = np.array(kinds), embeddings, least
        self.idle = self.meaning(STAND)

    def meaning(self, kind: str) -> Prompt:
        """What all wordings of a kind of motion have in common; standing still where it has none."""
        kind = kind if kind in self._kinds else STAND
        return Prompt(_unit(self._embeddings[self._kinds == kind].mean(axis=0)), kind, 1.0, True)

    def __call__(self, sentence: str) -> Prompt:
        """What a sentence means; warns where it means nothing."""
        likeness = self._embeddings @ self._encode(sentence)
        near = np.argsort(-likeness, kind="stable")[:VOTERS]
        best = float(likeness[near[0]])
        if best < self._least:
            known = ", ".join(dict.fromkeys(self._kinds))
            log.warning("%r means nothing to this model: it stands still; it has learnt: %s", sentence, known)
            return Prompt(self.idle.embedding, STAND, best, False)
        if best <= SAME and NEGATION.search(sentence):
            log.warning("%r says what not to do: it stands still; say what to do", sentence)
            return Prompt(self.idle.embedding, STAND, best, True)
        votes, kinds = np.exp(DECISION * (likeness[near] - best)), self._kinds[near]
        candidates = kinds[:1] if best > SAME else kinds
        kind = max(dict.fromkeys(candidates), key=lambda name: votes[kinds == name].sum())
        alike = self._kinds == kind
        mixture = np.exp(BREADTH * (likeness[alike] - best)) @ self._embeddings[alike]
        return Prompt(_unit(mixture), str(kind), best, True)


def _unit(vector: NDArray[np.float32]) -> NDArray[np.float32]:
    return (vector / np.linalg.norm(vector)).astype(np.float32)
