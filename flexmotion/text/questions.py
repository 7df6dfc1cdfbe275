"""`is_question`: sentences that ask for an answer, not for a motion: "why did you turn left?"."""

from __future__ import annotations

import re

QUESTION = "a question: the robot gives no answers; say what it is to do"
"""Refusal of a question in which a listener may hear a motion."""

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
