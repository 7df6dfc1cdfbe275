"""`reworded`: a sentence with one wording for what has several, before anything is read."""

from __future__ import annotations

import re
from functools import lru_cache

from flexmotion.text.no_walks import feet_verbs
from flexmotion.text.prompt_reader import FORBIDS
from flexmotion.text.vocabulary import vocabulary
from flexmotion.text.wording import stem

_ENUMERATED = re.compile(r"\s*(?:\(?(?:1|a|i)[.)]|(?:step|part|number)\s(?:one|1)\s?[:,.)])\s*[a-z]", re.IGNORECASE)
_ITEM = re.compile(
    r"(?:(?<=\s)|^)(?:\(?(?:\d{1,2}|[a-h]|i{1,3}|iv|v)[.)]\s*(?=[a-z])"
    r"|(?:step|part|number)\s(?:\w+)\s?[:,.)]\s*)",
    re.IGNORECASE,
)
_VOCATIVE = re.compile(r"\s*(?:(?:hey|hi|hello|ok|okay|dear|now)\s+)?[a-z]+-?\d+\s*[,:!]\s*(?=\w)", re.IGNORECASE)

_NOT_UNTIL = re.compile(
    r"(?<!\w)(?:do not|don't|never) ([^,.;!]+?),? (?:until|till|til|before) (?:after )?(?:you've|you have) ([^.;!]+)",
    re.IGNORECASE,
)


_POSTURE_FIRST = re.compile(
    r"\s*(?:with )?(?P<posture>(?:(?:your|the|both|two|one|right|left) )*(?:hands?|arms?|head)"
    r" (?:(?:on|up|out|down|behind|in|over|above|raised|stretched|spread|held|turned|tilted)\b)[^,.;!]*?)"
    r"(?:,(?: and)?| and) (?P<rest>(?P<verb>[a-z]+)\b.*)",
    re.IGNORECASE | re.DOTALL,
)


_BOTH = re.compile(
    r"\b(?P<opens>(?:(?:start|begin|keep|continue) )?)(?P<one>[a-z]+)\b"
    r"(?P<rest>(?:(?! and | then | while )[^,.;!?])*?)(?:,? and|,) (?P<other>[a-z]+ing)\b",
    re.IGNORECASE,
)
"""Two motions, the second as a participle: "nodding and walking"."""


def reworded(sentence: str) -> str:
    """The sentence in the grammar's own words: "at most" for "no more than", "please" for "would you mind".

    A list ("1. wave 2. bow") is in its order, and a name with a number in front ("OP3, wave") says nothing.
    """
    text = sentence.replace("’", "'").replace("‘", "'")
    found = text
    if match := _VOCATIVE.match(found):
        found = found[match.end() :]
    if _ENUMERATED.match(found):
        found = _ITEM.sub(" , then ", found).lstrip(" ,")
    found = _NOT_UNTIL.sub(_after_motion, found)
    if (match := _POSTURE_FIRST.fullmatch(found)) and stem(match["verb"].lower()) in vocabulary().words("paths"):
        found = f"keep {match['posture']} and {match['rest']}"  # "hands on hips, turn left"
    for pattern, same in _patterns():
        found = pattern.sub(same, found)
    if FORBIDS.search(found) is None:
        found = _BOTH.sub(_at_once, found)
    return sentence if found == text else " ".join(found.split())


def _after_motion(match: re.Match[str]) -> str:
    """A prohibition until a motion is over, as a request after it; other conditions leave a prohibition.

    "don't wave until you've bowed" is "after you have bowed, wave"; "don't wave until you've been told" is not.
    """
    motion, ended = match.groups()
    words, known = ended.lower().split(), vocabulary()
    verb = stem(words[0])
    amount = any(word.isdigit() or word in known.table["numbers"] or word in known.table["articles"] for word in words)
    if verb not in known.words("ended_motions") or (verb in known.words("ended_by_amount") and not amount):
        return match.group(0)
    return f"after you have {ended}, {motion}"


def _at_once(match: re.Match[str]) -> str:
    """Two participles, or a verb and a participle, of which one is a gesture's, as motions at the same time."""
    verbs = stem(match["one"].lower()), stem(match["other"].lower())
    gestures = {stem(phrase.split()[0]) for phrase in vocabulary().phrases("gesturing")}
    known = gestures | feet_verbs() | vocabulary().words("single_motions")
    more = {stem(word) for word in match["rest"].lower().split()} & gestures  # "walk nodding and waving"
    if not set(verbs) <= known or verbs[0] == verbs[1] or more or not gestures & set(verbs):
        return match.group(0)
    return f"{match['opens']}{match['one']}{match['rest']} while {match['other']}"


@lru_cache
def _patterns() -> tuple[tuple[re.Pattern[str], str], ...]:
    """Patterns that begin and end at the edge of a word, and their replacements."""
    return tuple(
        (re.compile(rf"(?:(?<!\w)|(?=\W))(?:{phrase})(?:(?<!\w)|(?!\w))", re.IGNORECASE), same)
        for phrase, same in vocabulary().table["same"].items()
    )
