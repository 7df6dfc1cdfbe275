"""`Listener`: classifies sentences by the kind of motion that they ask for."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from flexmotion.text.sayings import NOTHING
from flexmotion.text.sides import is_other_side, mirrored, sides

EMPHASIS = 4.0
"""Weight of the embedding, relative to 1 for each word piece."""

SURE, SURER = 0.45, 0.6
"""Least probability of a kind for the sentence to be understood; the second for strange sentences (`STRANGE`)."""

STRANGE = 0.6
"""Cosine with the nearest known wording below which a sentence is strange."""

CLEARER = 4.0
"""Least ratio of the probabilities of both sides, for a sentence that names both."""


class Listener:
    """Logistic regression on the embedding of a sentence and the word pieces in it.

    The embedding generalises to words outside the training sentences, but hardly separates "to the left" from "to the
    right"; word pieces separate them. A sentence that names one side is never classified as a motion to the other.

    Args:
        kinds: of motion, and `sayings.NOTHING`, (K,).
        pieces: numbers of the word pieces with a weight, (P,).
        weights: of the embedding (D rows), of the pieces (P rows) and bias (one row), (D + P + 1, K).
    """

    def __init__(self, kinds: Sequence[str], pieces: NDArray[np.int32], weights: NDArray[np.float32]) -> None:
        self.kinds, self._weights = tuple(kinds), weights
        self._row = {int(piece): row for row, piece in enumerate(pieces, start=len(weights) - 1 - len(pieces))}

    def __call__(
        self, sentence: str, embedding: NDArray[np.float32], pieces: Sequence[int], likeness: float = 1.0
    ) -> str:
        """The kind of motion, or `NOTHING`; see `heard`."""
        return self.heard(sentence, embedding, pieces, likeness)[0]

    def heard(
        self, sentence: str, embedding: NDArray[np.float32], pieces: Sequence[int], likeness: float = 1.0
    ) -> tuple[str, float]:
        """The kind of motion, or `NOTHING`, and the share of the most probable kind.

        Args:
            sentence: as given.
            embedding: of the sentence, (D,), of unit length.
            pieces: numbers of its word pieces.
            likeness: cosine of its embedding with that of the nearest known wording.
        """
        shares = self.shares(sentence, embedding, pieces)
        kind, share = self.kinds[int(shares.argmax())], float(shares.max())
        other = mirrored(kind)
        both = len(sides(sentence)) == 2 and other != kind and other in self.kinds
        if both and share < CLEARER * shares[self.kinds.index(other)]:
            return NOTHING, share
        return kind if share >= (SURER if likeness < STRANGE else SURE) else NOTHING, share

    def shares(self, sentence: str, embedding: NDArray[np.float32], pieces: Sequence[int]) -> NDArray[np.float32]:
        """Probability of each kind, (K,); see `__call__`."""
        rows = sorted({self._row[piece] for piece in pieces if piece in self._row})
        scores = EMPHASIS * embedding @ self._weights[: len(embedding)] + self._weights[-1]
        scores = scores + self._weights[rows].sum(axis=0)
        scores = np.where([is_other_side(kind, sentence) for kind in self.kinds], -np.inf, scores)
        shares = np.exp(scores - scores.max())
        return (shares / shares.sum()).astype(np.float32)
