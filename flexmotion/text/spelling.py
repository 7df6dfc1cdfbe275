"""`respelled`: a sentence with its unknown words replaced by the known ones nearest by letters, to be suggested."""

from __future__ import annotations

import difflib
import re
from functools import lru_cache

from flexmotion.text.phrases import kinds, wordings
from flexmotion.text.vocabulary import vocabulary
from flexmotion.text.wording import taught_words

LEAST_LIKENESS = 0.7
"""Least share of letters in common (`difflib`); "wlak" and "walk": 0.75."""
_SHORTEST = 4
"""Letters of a word that is respelled: shorter ones are near too many."""
_FOREIGN_SHARE = 0.5
"""Share of unknown words from which on a sentence is taken for one of another language."""


def respelled(sentence: str) -> str | None:
    """The sentence in known words; None where all are known, or one is near none of them."""
    if not (unknown := unknown_words(sentence)):
        return None
    for word in unknown:
        # The first letter stays, as in most misspellings.
        same = [one for one in _wording_words() if one[0] == word[0] and len(one) > 2]
        found = difflib.get_close_matches(word, same, 3, LEAST_LIKENESS) if len(word) >= _SHORTEST else []
        if not found:
            return None
        swapped = [one for one in found if sorted(one) == sorted(word)]  # "lfet" is "left" rather than "let"
        sentence = re.sub(rf"(?<![^\W\d_]){re.escape(word)}(?![^\W\d_])", (swapped or found)[0], sentence.lower())
    return sentence


def is_foreign(sentence: str) -> bool:
    """Whether so many words are unknown that the sentence may be of another language."""
    words = _words(sentence)
    return not words or len(unknown_words(sentence)) >= _FOREIGN_SHARE * len(words)


def unknown_words(sentence: str) -> list[str]:
    """Words of a sentence that no wording, no taught sentence and no verb has."""
    known = _wording_words() | taught_words() | vocabulary().verbs
    return [word for word in _words(sentence) if word not in known]


def _words(sentence: str) -> list[str]:
    return re.findall(r"[^\W\d_]+", sentence.lower())


@lru_cache
def _wording_words() -> frozenset[str]:
    """Words of the wordings, by which motions are suggested."""
    return frozenset(word for kind in kinds() for wording in wordings(kind) for word in _words(wording))
