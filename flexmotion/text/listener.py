"""`Listener`: which kind of motion a sentence asks for."""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

EMPHASIS = 4.0
"""An embedding counts so many times, beside its words that count one each."""

LEFT = re.compile(r"\bleft|\bcounterclockwise|\banti-?clockwise", re.IGNORECASE)
RIGHT = re.compile(
    r"\bright(?! (now|away|here|there|ahead|behind|in front|about|where|as|next|after))|(?<!anti-)\bclockwise",
    re.IGNORECASE,
)
"""Words that name a side; "right now" does not."""


class Listener:
    """Logistic regression on a sentence's embedding and on the word pieces in it.

    The embedding knows words that nobody wrote down, but "to the left" and "to the right" are nearly one to it; the
    pieces know exactly those that were. A sentence that names one side never means a motion to the other.

    Args:
        kinds: of motion, and `sayings.NOTHING`, (K,).
        pieces: numbers of the word pieces that count, (P,).
        weights: of the embedding (D rows), the pieces (P rows) and of nothing at all (one row), (D + P + 1, K).
    """

    def __init__(self, kinds: Sequence[str], pieces: NDArray[np.int32], weights: NDArray[np.float32]) -> None:
        self.kinds, self._weights = tuple(kinds), weights
        self._row = {int(piece): row for row, piece in enumerate(pieces, start=len(weights) - 1 - len(pieces))}
        self._only_left = np.array(["right" not in kind for kind in self.kinds])
        self._only_right = np.array(["left" not in kind for kind in self.kinds])

    def __call__(self, sentence: str, embedding: NDArray[np.float32], pieces: Sequence[int]) -> NDArray[np.float32]:
        """How likely each kind is meant, (K,), 1 together.

        Args:
            sentence: as it was said.
            embedding: of it, (D,), of unit length.
            pieces: numbers of its word pieces.
        """
        rows = sorted({self._row[piece] for piece in pieces if piece in self._row})
        scores = EMPHASIS * embedding @ self._weights[: len(embedding)] + self._weights[-1]
        scores = scores + self._weights[rows].sum(axis=0)
        left, right = LEFT.search(sentence), RIGHT.search(sentence)
        if bool(left) != bool(right):
            scores = np.where(self._only_left if left else self._only_right, scores, -np.inf)
        shares = np.exp(scores - scores.max())
        return (shares / shares.sum()).astype(np.float32)
