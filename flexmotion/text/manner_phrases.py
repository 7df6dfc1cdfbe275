"""`manner_phrases`: the words of a sentence that say how a motion is to be done, and the manner listed for them."""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import lru_cache

from flexmotion.text import manners

_FOR = r"for\s+(?:\d|an?|one|two|three|four|five|six|seven|eight|nine|ten|some|half)"
_ENDS = "and|then|while|until|for|twice|once|again|please|with|to|towards?|across|down|into|through"
_JOINT = rf"(?=\s*(?:$|[,.;!?]|\b(?:{_ENDS})\b))"

_NOUNS = "|".join(sorted(map(re.escape, manners.manner_nouns()), key=lambda noun: -len(noun)))

_OPEN = re.compile(
    rf"""\b(?P<like>(?:just\s|exactly\s)?like\s(?!to\b|you\s(?:to|facing|wave|being)\b)[^,.;!?]+?){_JOINT}
    | \b(?P<if>as\s(?:if|though)\s[^,.;!?]+?)(?=\s*(?:$|[,.;!?]|\b(?:and|then|while|twice|once|{_FOR})\b))
    | \b(?P<way>in\san?\s(?:[\w'-]+\s){{1,3}}(?:way|manner|fashion|style|mood|mode))\b
    | \b(?P<noun>(?:with|in|full\sof)\s(?:(?:an?|the|of|[\w'-]+)\s){{0,3}}?(?:{_NOUNS}))\b
    | \b(?P<adverb>\w+ly)\b""",
    re.VERBOSE,
)
"""Phrases that may say a manner, whichever their words are."""

_LIKING = re.compile(r"(?:'d|’d|\b(?:would|i|you|we|do|does|don't|did|to|looks?|sounds?|tastes?|feels?|smells?))\s$")
"""Words before "like" that make it a verb, or a comparison of something else than a motion."""


_SUBJECT = re.compile(r"\s*(?:an?|the|this|that)?\s*(\w+(?: (?:man|woman|lady|person))?)\b")
"""Who does it, at the beginning of a sentence."""


@dataclass(frozen=True)
class MannerPhrase:
    """Words that say how a motion is to be done.

    Attributes:
        text: the words, in lower case.
        manner: that they are known to mean; None: they are not known.
        start, end: place in the sentence.
    """

    text: str
    manner: str | None
    start: int
    end: int


def manner_phrases(sentence: str) -> tuple[MannerPhrase, ...]:
    """Every phrase of a sentence that says a manner, in order; words that ask for no manner ("politely") are none."""
    text = sentence.lower().replace("’", "'")
    known, lexicon = _lexicon()
    found: list[MannerPhrase] = []
    subject = _SUBJECT.match(text)
    if subject and (manner := _subjects().get(subject[1])):
        found.append(MannerPhrase(subject[1], manner, subject.start(1), subject.end(1)))
    for match in known.finditer(text):
        found.append(MannerPhrase(match[0], lexicon[match[0]], match.start(), match.end()))
    for match in _OPEN.finditer(text):
        if match["like"] and _LIKING.search(text[: match.start()]):
            continue
        over = [one for one in found if match.start() < one.end and one.start < match.end()]
        said = match[0].strip()
        if not over:
            found.append(MannerPhrase(said, lexicon.get(said), match.start(), match.end()))
        elif all(match.start() <= one.start and one.end <= match.end() for one in over):
            # "as if you were drunk": the listed word tells what the whole phrase means.
            found = [one for one in found if one not in over]
            found.append(MannerPhrase(said, over[0].manner, match.start(), match.end()))
    asking = (one for one in found if one.text not in manners.neutral_words() and one.manner != manners.NORMAL)
    return tuple(sorted(asking, key=lambda one: one.start))


def without_phrases(sentence: str, phrases: tuple[MannerPhrase, ...]) -> str:
    """The sentence without some of its phrases."""
    for phrase in sorted(phrases, key=lambda one: -one.start):
        sentence = f"{sentence[: phrase.start]} {sentence[phrase.end :]}"
    return " ".join(sentence.split())


@lru_cache
def _lexicon() -> tuple[re.Pattern[str], dict[str, str]]:
    """A pattern of all known phrases, the longest first, and their manners."""
    lexicon = {
        said.lower(): manner
        for manner in manners.manners()
        for said in (*manners.manner_wordings(manner), *manners.manner_sayings(manner), *manners.manner_words(manner))
    }
    longest = sorted(lexicon, key=lambda said: (-len(said), said))
    return re.compile(r"(?<![\w'-])(?:" + "|".join(map(re.escape, longest)) + r")(?![\w'-])"), lexicon


@lru_cache
def _subjects() -> dict[str, str]:
    return {said: manner for manner in manners.manners() for said in manners.manner_subjects(manner)}
