"""`meanwhile`: what a phrase says that is done beside a motion: "while waving", "with your hands on your hips"."""

from __future__ import annotations

from itertools import dropwhile

from flexmotion.text.amounts import Token, tokens_of
from flexmotion.text.sentence_parts import NEGATES
from flexmotion.text.vocabulary import vocabulary
from flexmotion.text.wording import begins, stem


def meanwhile(phrase: str) -> str | None:
    """The words of a request in a phrase that a request leaves out; None where it is no such phrase.

    Args:
        phrase: of `Clause.dropped`.
    """
    known, tokens = vocabulary(), list[Token](phrase.split())
    opening = begins(tokens, 0, (*known.phrases("together"), *known.phrases("posture_opens")))
    doing = begins(tokens, 0, (*known.phrases("doing"), *known.phrases("gesturing")))
    if NEGATES.search(phrase) or not (opening or doing):
        return None
    words = phrase.split()[0 if opening is None else len(opening.split()) :]
    words = list(dropwhile(lambda word: word in ("you", "are", "you're"), words))
    if not words or not (is_posture(phrase) or stem(words[0]) in known.verbs):
        return None  # "while she waves at you": what others do
    return " ".join([stem(words[0]), *words[1:]])


def is_posture(phrase: str) -> bool:
    """Whether a phrase tells how a part of the body is held: "with raised hands"."""
    return begins(list(tokens_of(phrase)), 0, vocabulary().phrases("posture_opens")) is not None


def says_at_once(phrase: str) -> bool:
    """Whether a phrase says that two requests are done at the same time."""
    return phrase in vocabulary().phrases("at_once")
