"""Misspelt words replaced by known ones: `respelled`, to be suggested, and `as_meant`, to be done.

A direction or a count ("twice") that is mistyped is done as it is meant, and a note says so: a listener hears the rest
of the sentence alone, and "point to the lfet" is "point" to it. No other word is replaced in what is done.
"""

from __future__ import annotations

import difflib
import re
from collections.abc import Callable
from functools import lru_cache

from flexmotion.text.phrases import kinds, wordings
from flexmotion.text.vocabulary import vocabulary
from flexmotion.text.wording import taught_words

LEAST_LIKENESS = 0.7
"""Least share of letters in common (`difflib`); "wlak" and "walk": 0.75."""
_SHORTEST = 4
"""Letters of a word that is respelled: shorter ones are near too many."""
_SHORTEST_MEANT = 3
"""Letters of a word that is read as a direction or a count: "lft"."""
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
        sentence = _as_word(word).sub((swapped or found)[0], sentence.lower())
    return sentence


def as_meant(sentence: str, is_word: Callable[[str], bool]) -> tuple[str, tuple[str, ...]]:
    """The sentence with its mistyped directions and counts as they are meant, and a note of each.

    A word is a mistyped one of them where one letter is wrong, missing or too many, or two neighbours are swapped.

    Args:
        is_word: whether a word in lower case is one of the language: "loft" is none that is mistyped.
    """
    notes = []
    for word in dict.fromkeys(unknown_words(sentence)):
        meant = _meant(word)
        if meant is None or is_word(word):
            continue
        sentence = _as_word(word).sub(meant, sentence)
        notes.append(f"{word!r} is read as {meant!r}")
    return sentence, tuple(notes)


def _as_word(word: str) -> re.Pattern[str]:
    """The word between characters that are no letters, in either case."""
    return re.compile(rf"(?<![^\W\d_]){re.escape(word)}(?![^\W\d_])", re.IGNORECASE)


def _meant(word: str) -> str | None:
    """Direction or count that a mistyped word may mean, of several the nearest by length; None: it means none."""
    found = [one for one in sorted(vocabulary().words("read_mistyped")) if _is_mistyped(word, one)]
    return min(found, key=lambda one: abs(len(one) - len(word)), default=None)


def _is_mistyped(word: str, meant: str) -> bool:
    """Whether one letter differs, or two neighbours are swapped; the first letter differs by a swap alone."""
    if word == meant or abs(len(word) - len(meant)) > 1 or len(word) < _SHORTEST_MEANT:
        return False
    same = next((place for place, (a, b) in enumerate(zip(word, meant, strict=False)) if a != b), len(meant))
    left, right = word[same:], meant[same:]
    if left[:2] == right[1::-1] and left[2:] == right[2:] and len(left) > 1:
        return True
    return same > 0 and (left[1:] == right[1:] or left[1:] == right or left == right[1:])


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
