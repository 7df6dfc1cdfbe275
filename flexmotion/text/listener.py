"""`Listener`: which kind of motion a sentence asks for."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from flexmotion.text.sayings import NOTHING
from flexmotion.text.sides import is_other_side, mirrored, sides

EMPHASIS = 4.0
"""An embedding counts so many times, beside its words that count one each."""

SURE, SURER = 0.45, 0.6
"""A sentence means something where one kind is as likely; the greater, where it is like nothing known (`STRANGE`)."""

STRANGE = 0.6
"""Likeness to the nearest known wording below which a sentence is like nothing known."""

CLEARER = 4.0
"""A sentence that names both sides means one of them where it is so many times as likely as the other."""


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

    def __call__(
        self, sentence: str, embedding: NDArray[np.float32], pieces: Sequence[int], likeness: float = 1.0
    ) -> str:
        """The kind that is meant, or `NOTHING`.

        Args:
            sentence: as it was said.
            embedding: of it, (D,), of unit length.
            pieces: numbers of its word pieces.
            likeness: cosine of its embedding with that of the nearest known wording.
        """
        shares = self.shares(sentence, embedding, pieces)
        kind, share = self.kinds[int(shares.argmax())], float(shares.max())
        other = mirrored(kind)
        both = len(sides(sentence)) == 2 and other != kind and other in self.kinds
        if both and share < CLEARER * shares[self.kinds.index(other)]:
            return NOTHING
        return kind if share >= (SURER if likeness < STRANGE else SURE) else NOTHING

    def shares(self, sentence: str, embedding: NDArray[np.float32], pieces: Sequence[int]) -> NDArray[np.float32]:
        """How likely each kind is meant, (K,), 1 together; see `__call__`."""
        rows = sorted({self._row[piece] for piece in pieces if piece in self._row})
        scores = EMPHASIS * embedding @ self._weights[: len(embedding)] + self._weights[-1]
        scores = scores + self._weights[rows].sum(axis=0)
        scores = np.where([is_other_side(kind, sentence) for kind in self.kinds], -np.inf, scores)
        shares = np.exp(scores - scores.max())
        return (shares / shares.sum()).astype(np.float32)
