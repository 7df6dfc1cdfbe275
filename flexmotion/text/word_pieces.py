"""Sentences to word pieces by greedy longest match, as for BERT's vocabularies, for plain English."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Sequence

UNKNOWN = "[UNK]"
CONTINUED = "##"
LONGEST = 64
"""Greatest number of pieces of a sentence; further ones are ignored."""


class WordPieces:
    """Maps sentences to numbers of word pieces.

    Args:
        vocabulary: pieces in the order of their numbers, `[UNK]` among them.
    """

    def __init__(self, vocabulary: Sequence[str]) -> None:
        self._number = {piece: number for number, piece in enumerate(vocabulary)}
        self.unknown = self._number[UNKNOWN]

    def __call__(self, sentence: str) -> list[int]:
        """Numbers of the pieces of a sentence, at most `LONGEST`; empty for a sentence without words."""
        plain = unicodedata.normalize("NFD", sentence.lower())
        plain = "".join(letter for letter in plain if not unicodedata.combining(letter))
        pieces: list[int] = []
        for word in re.findall(r"[^\W_]+", plain):
            pieces += self._word(word)
        return pieces[:LONGEST]

    def is_word(self, word: str) -> bool:
        """Whether a word in lower case is a piece as a whole."""
        return word in self._number

    def _word(self, word: str) -> list[int]:
        found, start = [], 0
        while start < len(word):
            prefix = CONTINUED if start else ""
            for end in range(len(word), start, -1):
                number = self._number.get(prefix + word[start:end])
                if number is not None:
                    found.append(number)
                    start = end
                    break
            else:
                return [self.unknown]
        return found
