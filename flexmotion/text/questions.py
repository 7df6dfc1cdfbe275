"""`is_question`, `is_report`, `without_report`: what asks for no motion: "why did you turn left?", "he waved at me"."""

from __future__ import annotations

import re

from flexmotion.text.vocabulary import vocabulary
from flexmotion.text.wording import stem

QUESTION = "a question: the robot gives no answers; say what it is to do"
"""Refusal of a question in which a listener may hear a motion."""

REPORT = "it tells of something, and asks for no motion; say what the robot is to do"
"""Refusal of a report."""

_SUBJECT = r"(?:you|i|we|it|he|she|they|the|this|that|there|your|my|anyone|anybody|somebody|someone)"
_ASIDE = r"(?:(?:and|so|but|hey|ok|okay|oh|well|please|robot|hmm|um)[\s,]+)*"
_ASKS_WHAT = (
    r"(?:why|how|what|when|where|who|whom|whose|which)\b.*?\b(?:do|does|did|is|are|am|was|were|has|have|had"
    rf"|will|would|can|could|should|shall|may|might)\s{_SUBJECT}\b"
    r"|who\s(?:told|asked|made|taught|ordered|allowed)\s(?:you|it)\b.*?"
)
_ASKS_WHETHER = (
    rf"(?:did|does|is|are|am|was|were|had)\s{_SUBJECT}\b(?!\s(?:able|ready|willing))"
    r"|(?:do|have|has)\s(?:you|they|we|i|he|she)\b(?!\s(?:know\show|mind|want|wish|dare|care))"
)
_QUESTION = re.compile(rf"\s*{_ASIDE}(?:{_ASKS_WHAT}|{_ASKS_WHETHER})[^,.;:!?]*[.!?\s]*", re.IGNORECASE)


def is_question(sentence: str) -> bool:
    """Whether a whole sentence is a question; one that a request follows ("where is it? point left") is none.

    Polite forms of a request ("can you wave?", "are you able to bow?") are none.
    """
    inside = re.sub(r"[.!?\s]+$", "", sentence)
    return not re.search(r"[.;:!?]", inside) and _QUESTION.fullmatch(sentence) is not None


_REPORT = re.compile(
    r"(?:i|you|he|she|they|we|it|someone|somebody|(?:the|a|an|my|your|his|her)\s\w+)\s"
    r"(?:(?:just|also|then|only|already|once|never)\s)?(?P<verb>\w+)\b.*",
    re.IGNORECASE | re.DOTALL,
)
_THERE_IS = re.compile(r"there(?:['’]s|['’]re|\s(?:is|are|was|were))\s[^,;:]+", re.IGNORECASE)


def is_report(sentence: str) -> bool:
    """Whether a sentence tells what someone did, or what there is. Captions ("a person waves") are none."""
    if _THERE_IS.fullmatch(sentence.strip()):
        return True
    found = _REPORT.fullmatch(sentence.strip())
    if found is None:
        return False
    verb = found["verb"].lower()
    past = verb in vocabulary().words("past") or (verb.endswith("ed") and stem(verb) != verb)
    return past and stem(verb) in vocabulary().verbs | set(vocabulary().table["past"])


_BEHIND_REPORT = re.compile(
    r"[^,.;:!]+[,.;!]+\s*(?P<rest>(?:(?:now|so|please|ok|okay|then please|just)[\s,]+)*(?P<verb>\w+)\b.*)",
    re.IGNORECASE | re.DOTALL,
)


_SAID = frozenset(
    ["shout", "say", "said", "tell", "told", "ask", "asked", "call", "yelled", "repeat", "speak", "answer", "reply"]
)
"""Verbs behind which words are someone else's: "he shouted, walk forward"."""


def without_report(sentence: str) -> str:
    """The sentence without a report in front of what it asks for: "you did well, now bow"; others as they are.

    Behind a mark a verb that is no past asks for something: "he sat down, put on his hat" is a report.
    """
    found = _BEHIND_REPORT.fullmatch(sentence.strip())
    told = "" if found is None else sentence[: sentence.index(found["rest"])].rstrip(" ,.;!")
    if found is None or not is_report(told) or _SAID & {stem(word) for word in told.lower().split()}:
        return sentence
    known, verb = vocabulary(), found["verb"].lower()
    return found["rest"] if verb in known.verbs and verb not in known.words("past") else sentence
