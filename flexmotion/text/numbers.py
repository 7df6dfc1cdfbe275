"""`number_at`: a number in words or digits at a place of a sentence."""

from __future__ import annotations

import math
import re
from typing import NamedTuple

from flexmotion.text.vocabulary import vocabulary

_DIGITS = re.compile(r"-?(?:\d+(?:\.\d+)?|\.\d+)")
_PI = re.compile(r"pi(?:/(.*))?")
_LONGEST = 12
"""Digits of a number; a longer one is a word."""


class Number(NamedTuple):
    """A number of a sentence.

    Attributes:
        value: as said.
        used: how many words it takes.
        rough: the words name none ("a few"), `value` is what is taken for them.
        article: it is a mere "a" or "another".
    """

    value: float
    used: int
    rough: bool = False
    article: bool = False


def is_digits(word: str) -> bool:
    """Whether a word is a number in digits."""
    return len(word) <= _LONGEST and _DIGITS.fullmatch(word) is not None


def pi_of(word: str) -> float | None:
    """Value of "pi" and "pi/2", as one word; None for other words, and where no number above 0 divides it."""
    found = _PI.fullmatch(word)
    divisor = "1" if found is not None and found[1] is None else "" if found is None else found[1]
    return math.pi / float(divisor) if is_digits(divisor) and float(divisor) > 0.0 else None


def number_at(words: list[str], place: int) -> Number | None:
    """The number that begins at a word, also as a multiple of pi ("3 pi/4"); None where none does."""
    number = _number_at(words, place)
    if number is None or number.article or pi_of(words[place]) is not None:
        return number
    pi = pi_of("".join(words[place + number.used : place + number.used + 1]))
    return number if pi is None else number._replace(value=number.value * pi, used=number.used + 1)


def _number_at(words: list[str], place: int) -> Number | None:
    """The number that begins at a word, without a pi behind it."""
    table = vocabulary().table
    numbers, fractions, articles, vague = (table[name] for name in ("numbers", "fractions", "articles", "vague"))

    def at(index: int) -> str:
        return words[index] if index < len(words) else ""

    first = at(place)
    if (pi := pi_of(first)) is not None:
        return Number(pi, 1)
    if (dozens := _dozens(words, place)) is not None:
        return dozens
    if first in vague:
        return Number(float(vague[first]), 1, rough=True)
    if first in articles and at(place + 1) in vague:
        return Number(float(vague[at(place + 1)]), 2 + (at(place + 2) == "of"), rough=True)
    if first in fractions:
        return Number(float(fractions[first]), 1)
    if first in articles and at(place + 1) in fractions:
        return Number(float(fractions[at(place + 1)]), 2)
    if is_digits(first):
        value, used = float(first), 1
        if at(place + 1) in ("hundred", "thousand"):
            value, used = value * numbers[at(place + 1)], 2
        return _with_fraction(words, place, Number(value, used))
    if first in articles and at(place + 1) in ("hundred", "thousand"):
        value, used = _named(words, place + 1)
        return Number(value, used + 1)
    if first in articles:
        return Number(float(articles[first]), 1, article=True)
    if first not in numbers:
        return None
    value, used = _named(words, place)
    following = at(place + used)
    if following in fractions and fractions[following] < 0.5 + 1e-9 and following != "half":
        return Number(value * fractions[following], used + 1)
    if following == "point" and at(place + used + 1) in numbers:
        return Number(float(f"{int(value)}.{numbers[at(place + used + 1)]}"), used + 2)
    return _with_fraction(words, place, Number(value, used))


def _with_fraction(words: list[str], place: int, number: Number) -> Number:
    """The number with "and a half", "and three quarters" behind it."""
    end = place + number.used
    # "between 0.3 and 0.5" names two numbers.
    if words[end : end + 1] != ["and"] or words[place - 1 : place] == ["between"] or number.value % 1.0:
        return number
    rest = number_at(words, end + 1) if end + 1 < len(words) else None
    if rest is None or rest.rough or rest.article or not 0.0 < rest.value < 1.0:
        return number
    # "one and half a turn" counts two things.
    if words[end + 1] in vocabulary().table["fractions"]:
        return number
    return Number(number.value + rest.value, number.used + 1 + rest.used)


def _dozens(words: list[str], place: int) -> Number | None:
    """As in "a dozen", "half a dozen", "two dozen"."""
    table = vocabulary().table
    for used in (1, 2, 3):
        if words[place + used - 1 : place + used] != ["dozen"]:
            continue
        before = words[place : place + used - 1]
        if before in (["a"], []):
            return Number(12.0, used)
        if before in (["half", "a"], ["half"], ["a", "half"]):
            return Number(6.0, used)
        if len(before) == 1 and (before[0] in table["numbers"] or is_digits(before[0])):
            return Number(12.0 * float(table["numbers"].get(before[0], before[0])), used)
    return None


def _named(words: list[str], place: int) -> tuple[float, int]:
    """Value of number words from a place on ("one hundred and eighty"), and how many they are."""
    numbers = vocabulary().table["numbers"]
    total = current = 0.0
    used, last = 0, 0.0
    while place + used < len(words):
        word = words[place + used]
        if word == "and" and last in (100.0, 1000.0) and words[place + used + 1 : place + used + 2]:
            if words[place + used + 1] not in numbers or numbers[words[place + used + 1]] >= 100:
                break
            used += 1
            continue
        if word not in numbers or (used and word == "pi"):
            break
        value = float(numbers[word])
        if value >= 1000:
            total, current = total + max(current, 1.0) * value, 0.0
        elif value >= 100:
            current = max(current, 1.0) * value
        elif used == 1 and 1 <= last < 10 and value >= 10:
            current = 100.0 * current + value  # "one eighty"
        elif used and not (last >= 20 and value < 10) and last not in (100.0, 1000.0):
            break  # "two three" are two numbers
        else:
            current += value
        used, last = used + 1, value
    return total + current, used
