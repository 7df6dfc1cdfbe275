"""`asks_to_stand`: whether a sentence asks for nothing but a stand, where no model listens to it."""

from __future__ import annotations

from flexmotion.text.alarm import is_alarm
from flexmotion.text.amounts import tokens_of
from flexmotion.text.grammar import parse
from flexmotion.text.phrases import STAND, wordings
from flexmotion.text.vocabulary import vocabulary
from flexmotion.text.wording import plain, stripped


def asks_to_stand(sentence: str) -> bool:
    """Whether a whole sentence asks for a stand: "stop", "please stand still", "stop following me", "don't move"."""
    if is_alarm(sentence):
        return True
    clauses = parse(sentence)
    if len(clauses) != 1:
        return False
    words = plain(stripped(tokens_of(clauses[0].text)))
    return words in wordings(STAND) or words.split(" ")[0] in vocabulary().words("stop_verbs")
