"""`MannerReader`: the manner that a sentence asks for, among those that a model offers."""

from __future__ import annotations

import re
from collections.abc import Collection
from dataclasses import dataclass

from flexmotion.text.listener import Listener
from flexmotion.text.manner_phrases import MannerPhrase, manner_phrases
from flexmotion.text.manners import NORMAL, manners
from flexmotion.text.sayings import NOTHING
from flexmotion.text.sentence_encoder import SentenceEncoder

SURE, SURE_OF_NORMAL = 0.5, 0.8
"""Least probability of a manner; a phrase that is taken for the normal one is not done and not told, so it must be
surer."""


@dataclass(frozen=True)
class HeardManner:
    """How a sentence asks for its motion.

    Attributes:
        manner: that is done.
        phrases: every phrase of the sentence that says a manner.
        dropped: those that are not done, because the model does not offer their manner, does not know it, or does
            another one.
    """

    manner: str
    phrases: tuple[MannerPhrase, ...]
    dropped: tuple[str, ...]

    @property
    def all_dropped(self) -> tuple[str, ...]:
        """All phrases, for a motion that has one manner only."""
        return tuple(phrase.text for phrase in self.phrases)


class MannerReader:
    """Maps sentences to manners.

    Args:
        encode: sentence encoder.
        offered: manners of the model; a personal one is known by its own words.
        listener: classifies phrases whose words are not listed; None: those are dropped.
    """

    def __init__(self, encode: SentenceEncoder, offered: Collection[str], listener: Listener | None) -> None:
        self._encode, self._offered, self._listener = encode, frozenset(offered), listener
        personal = sorted((name for name in offered if name not in manners()), key=len, reverse=True)
        self._names = {name.lower(): name for name in personal}
        # The longest first: "like Ada Lovelace" is another person than "like Ada".
        manner_phrases("walk like an old man now")  # compiles its patterns: a live planner has no time for that
        self._personal = re.compile(rf"(?<!\w)(?:{'|'.join(map(re.escape, personal))})(?!\w)", re.IGNORECASE)

    def __call__(self, sentence: str) -> HeardManner:
        """The manner of a sentence."""
        phrases = tuple(found for found in map(self._known, self._phrases(sentence)) if found.manner != NORMAL)
        done = next((phrase.manner for phrase in phrases if phrase.manner in self._offered), None)
        dropped = tuple(phrase.text for phrase in phrases if phrase.manner is None or phrase.manner != done)
        return HeardManner(done or NORMAL, phrases, dropped)

    def _phrases(self, sentence: str) -> tuple[MannerPhrase, ...]:
        own = [
            MannerPhrase(match[0].lower(), self._names[match[0].lower()], match.start(), match.end())
            for match in (self._personal.finditer(sentence) if self._names else ())
        ]
        others = (
            phrase
            for phrase in manner_phrases(sentence)
            if not any(phrase.start < one.end and one.start < phrase.end for one in own)
        )
        return tuple(sorted([*own, *others], key=lambda phrase: phrase.start))

    def _known(self, phrase: MannerPhrase) -> MannerPhrase:
        """The phrase with its manner; without one where nobody knows it."""
        if phrase.manner is not None or phrase.doubtful or self._listener is None:
            return phrase
        pieces = self._encode.pieces(phrase.text)
        heard, share = self._listener.heard(phrase.text, self._encode(phrase.text), pieces)
        unsure = heard == NOTHING or share < (SURE_OF_NORMAL if heard == NORMAL else SURE)
        return MannerPhrase(phrase.text, None if unsure else heard, phrase.start, phrase.end)
