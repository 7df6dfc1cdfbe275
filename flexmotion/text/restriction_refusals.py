"""`restriction_refusal`: why words that mean a restriction are not done, alone in other words or beside a request.

A restriction is a promise to whoever stands next to the robot: half of it, or a motion instead of it, is worse than a
refusal. What `restriction_phrase` hears as a whole is not meant here, but in a prompt or a script, which hold none.
"""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterator
from itertools import islice, product

from flexmotion.text.amounts import tokens_of
from flexmotion.text.restriction_phrases import BOTH_FEET, LEAST_NM, OWN, restriction_phrase, restriction_words
from flexmotion.text.rewording import reworded
from flexmotion.text.spelling import LEAST_LIKENESS, unknown_words
from flexmotion.text.wording import plain, taught

_SIDED = rf"(?:{OWN}\s)?(?P<side>left|right)\s(?:foot|feet|leg|heel|toes?|sole)"
_FLOOR = r"(?:ground|floor)"
_NOT = r"(?:not|never|no|don\st|dont|cannot|without|avoid|mustn\st|won\st)"
_MUST = r"(?:must|should|has\sto|have\sto|is\sto|needs?\sto|will|always)"
_FOOT_KEPT = tuple(
    re.compile(rf"\b{pattern}\b")
    for pattern in (
        rf"(?:keep|hold|leav|plant)(?:e|s|ing)?\s(?:\w+\s)?{_SIDED}",
        rf"{_SIDED}\s(?:{_MUST}\s)*(?:not\s(?:leave|lift|move|come)|stays?|remains?|(?:is\s)?(?:planted|still|fixed))",
        rf"{_NOT}\s(?:\w+\s)?(?:lift|rais|mov|pick)(?:e|s|ing)?\s(?:up\s)?{_SIDED}",
        rf"{_NOT}\s(?:let|have|letting)\s{_SIDED}",
        rf"you\s(?:may|can)\s(?:lift|raise|move)\s{_SIDED}",
        rf"let\s{_SIDED}\sgo",
        rf"(?:keep|hold|stay|remain)\sstill\s\w+\s{_SIDED}",
        # Of both feet the grammar knows "do not move your feet, …", which other requests go with.
        rf"(?:keep|hold|leav)(?:e|s|ing)?\s{BOTH_FEET}\s(?:flat\s|down\s|planted\s)*(?:on\s(?:the\s)?{_FLOOR}|down|planted)",
        rf"{BOTH_FEET}\s(?:{_MUST}\s)*(?:stays?|remains?)\s(?:flat\s|down\s|planted\s)*(?:on\s(?:the\s)?{_FLOOR}|down|planted)",
        rf"{_NOT}\s(?:lift|rais)(?:e|s|ing)?\s(?:up\s)?{BOTH_FEET}",
    )
)
_TORQUE = re.compile(r"\b(?:nm|newtons?|torques?)\b")

_LIMB = rf"(?:both\s(?:of\s)?)?(?:{OWN}\s)?(?:both\s)?(?:left\s|right\s)?(?:arms?|head|neck|hands?|shoulders?)"
_SOFT = r"(?:soft|loose|stiff|tense|firm)(?:e?r)?|slack(?:er)?|limp(?:er)?|floppy|floppier|rigid|relaxed|free"
_TENSE = re.compile(
    rf"(?P<undone>\b(?:{_NOT}|stop)\s(?:\w+\s)?)?(?<!to\s)\b(?:"
    rf"(?:soften|loosen|slacken|stiffen|tens(?:e(?!d))?)(?:ing)?\s(?:up\s)?{_LIMB}"
    rf"|(?:make|let|keep|hold|leav|have)(?:e|ing)?\s{_LIMB}\s(?:(?:be|go|get|become|more|very|a\sbit|as|too)\s)*(?:{_SOFT}))\b"
)
_ONWARD = (
    r"(?!\s(?:up|down|out|over|to|back|left|right|around|round|forwards?|ahead|above|in|behind|by|straight|high)\b)"
)
_UNTENSE = re.compile(
    rf"\b(?:let|leave)\s{_LIMB}\sgo\b{_ONWARD}|(?<!to\s)\b(?:relax(?:ing)?|release|free|untense|let\sgo(?:\sof)?)\s{_LIMB}\b"
)

_LEXICON = re.findall(
    r"\w+",
    """keep hold leave plant lift raise move stay stays remain your the its both left right foot feet leg legs down
    still planted ground floor loosen soften slacken stiffen tense relax arms head neck newton metre metres torque""",
)
_SHORTEST = 3
_INFLECTED = ("ed", "er", "ly")
"""Endings of words that are not respelled: "relaxed" and "stiffly" say a manner."""
_NEAR = 2
"""Words that an unknown one is tried as: "lft" is as near to "lift" as to "left"."""
_TRIES = 16
"""Spellings of a sentence that are tried."""


def restriction_refusal(sentence: str) -> str | None:
    """Why a sentence that means a restriction, or the end of one, is not done; None where it means none.

    It is asked for sentences that no run has taken as a restriction: those of prompts and scripts, and all in which
    `restriction_phrase` hears none.
    """
    if restriction_phrase(sentence) is not None:
        return (
            f"{sentence!r}: a restriction is sent to a run that takes targets (flexmotion send {sentence!r}); "
            "a prompt or a script holds none"
        )
    if plain(tokens_of(sentence)) in taught():
        return None  # "plant your feet and wait"
    spellings = map(restriction_words, _spellings(reworded(sentence)))
    return next((f"{sentence!r}: {why}" for words in spellings if (why := _why(words)) is not None), None)


def _why(words: str) -> str | None:
    """Why words that mean a restriction are not done; None where they mean none."""
    kept = next((found for pattern in _FOOT_KEPT if (found := pattern.search(words)) is not None), None)
    if kept is not None:
        side = kept.groupdict().get("side")
        foot, name = (f"your {side} foot", side) if side else ("both feet", "both")
        return (
            "where a foot stays is a restriction, and goes with no other words: "
            f"say 'keep {foot} down' on its own first (flexmotion send --contact {name})"
        )
    if _TORQUE.search(words) is not None:
        return (
            f"a torque is capped in a sentence of its own, to {LEAST_NM:g} N·m or more: "
            "say 'no more than 1 newton metre at the knee' (flexmotion send --torque knee 1)"
        )
    tense = _TENSE.search(words)
    if tense is not None and not tense["undone"]:
        return (
            "how stiff arms and head are is a restriction, and goes with no other words: say 'loosen your arms' or "
            "'stiffen your left arm' on its own (flexmotion send --tension 'left arm' 1)"
        )
    if tense is not None or _UNTENSE.search(words) is not None:
        return (
            "no words let a tension go: flexmotion send --relax 'tension both arms'; "
            "'loosen your arms' makes them soft, 'lower your arms' puts them down"
        )
    return None


def _spellings(sentence: str) -> Iterator[str]:
    """The sentence, and with unknown words as the words of restrictions that they are near to: "dwn" as "down".

    It tells what is refused, and is never done: a foot that was not meant is not kept.
    """
    sentence = sentence.lower()
    near: dict[str, list[str]] = {}
    for word in unknown_words(sentence):
        if len(word) < _SHORTEST or word in _LEXICON or word.endswith(_INFLECTED):
            continue
        same = [one for one in _LEXICON if one[0] == word[0]]
        if found := difflib.get_close_matches(word, same, _NEAR, LEAST_LIKENESS):
            near[word] = found
    yield sentence
    for meant in islice(product(*near.values()), _TRIES) if near else ():
        spelt = dict(zip(near, meant, strict=True))
        yield " ".join(spelt.get(word, word) for word in re.findall(r"[^\W\d_]+|[^\s\w]+|[\d_]+", sentence))
