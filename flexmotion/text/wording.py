"""Words of a sentence's tokens: how a part begins, a verb without "-ing", sentences that models are taught."""

from __future__ import annotations

from functools import lru_cache

from flexmotion.text.amounts import Token, is_mark, tokens_of
from flexmotion.text.sayings import sayings
from flexmotion.text.vocabulary import vocabulary

STAND_IN = "inthatmanner"
"""How a word that stands for a phrase of manner begins."""


@lru_cache
def taught() -> dict[str, str]:
    """Kind of motion by taught sentence."""
    return {plain(tokens_of(sentence)): kind for kind, sentence in sayings()}


@lru_cache
def taught_words() -> frozenset[str]:
    """Words of the taught sentences."""
    return frozenset(word for sentence in taught() for word in sentence.split())


def plain(tokens: list[Token]) -> str:
    """The tokens as words, without punctuation."""
    return " ".join(_said(token) for token in tokens if not is_mark(token))


def _said(token: Token) -> str:
    return token if isinstance(token, str) else token.said


def begins(tokens: list[Token], place: int, phrases: tuple[str, ...]) -> str | None:
    """The phrase that begins at a token; the longest one."""
    for phrase in phrases:
        words = phrase.split()
        if words and tokens[place : place + len(words)] == words:
            return phrase
    return None


def stem(word: str) -> str:
    """A verb without "-ing" or "-ed": "waving" -> "wave", "spun" -> "spin"; the word itself where none fits."""
    verbs = vocabulary().verbs
    if word in vocabulary().table["participles"]:
        return str(vocabulary().table["participles"][word])
    if word.endswith("ing") and len(word) >= 6:
        root = word[:-3]
    elif word.endswith("ed") and len(word) >= 5 and word not in verbs:
        root = word[:-2]
    else:
        return word
    tries = (root, root + "e", root[:-1] if root[-1:] == root[-2:-1] else root)
    return next((found for found in tries if found in verbs), word)


def stripped(tokens: list[Token]) -> list[Token]:
    """Without fillers at both ends."""
    fillers = vocabulary().phrases("fillers")
    changed = True
    while changed and tokens:
        changed = False
        for phrase in fillers:
            words = phrase.split()
            if tokens[: len(words)] == words and len(tokens) > 0:
                tokens, changed = tokens[len(words) :], True
            if tokens and tokens[-len(words) :] == words:
                tokens, changed = tokens[: -len(words)], True
    first = vocabulary().phrases("first")
    while tokens and (opening := begins(tokens, 0, first)):
        tokens = tokens[len(opening.split()) :]
    if opens_by_number(tokens):
        return stripped(tokens[1:])
    if tokens and isinstance(tokens[0], str):
        tokens = [stem(tokens[0]), *tokens[1:]]
    return tokens


def opens_by_number(tokens: list[Token]) -> bool:
    """Whether a request begins with its place in the sentence: "third, wave"."""
    known = vocabulary()
    following = tokens[2:3] if tokens[1:2] == ["you"] else tokens[1:2]
    return bool(following) and tokens[0] in known.words("ordinals") and following[0] in known.verbs
