"""`Amount`: numbers with their units in sentences, in words and in digits."""

from __future__ import annotations

import re
from dataclasses import dataclass

from flexmotion.text.vocabulary import Quantity, vocabulary

_NUMBER = re.compile(r"-?(?:\d+(?:\.\d+)?|\.\d+)")
_LONGEST_NUMBER = 12
"""Digits of a number; a longer one is a word."""

_SYMBOLS = {
    "°": " degrees ",
    "º": " degrees ",
    "½": " half ",
    "¼": " quarter ",
    "¾": " three quarters ",
    "×": " times ",
}
_WORD = re.compile(r"(?<![\w.])-(?:\d+(?:\.\d+)?|\.\d+)|\d+(?:\.\d+)?|\.\d+|[^\W\d_]+(?:['\-][^\W\d_]+)*|[,.;:!?&]")
_MARKS = frozenset(",.;:!?&")


@dataclass(frozen=True)
class Amount:
    """How much of something: `value` in radians, metres, steps, seconds or times; `said`: the words for it.

    Attributes:
        rough: the words name no number ("a few"), `value` is what is taken for them.
    """

    value: float
    quantity: Quantity
    said: str
    rough: bool = False

    def __str__(self) -> str:
        if self.quantity == "angle":
            return f"{self.value * 57.29577951308232:.4g}°"
        unit = {"length": "m", "time": "s", "steps": "step", "times": "time"}[self.quantity]
        plural = "s" if self.quantity in ("steps", "times") and self.value != 1 else ""
        return f"{self.value:.4g} {unit}{plural}"


@dataclass(frozen=True)
class Bare:
    """A number in digits without a unit ("turn 90")."""

    value: float
    said: str


Token = str | Amount | Bare
"""A word or a punctuation mark, an amount, or a number without unit."""


def words_of(sentence: str) -> list[str]:
    """Words, numbers and punctuation marks of a sentence, in lower case."""
    text = sentence.lower().replace("’", "'").replace("‘", "'")
    for symbol, name in _SYMBOLS.items():
        text = text.replace(symbol, name)
    # "1,000" is a number, "1, 2" are two.
    text = re.sub(r"(?<=\d),(?=\d{3}\b)", "", text)
    numbers, words = vocabulary().table["numbers"], list[str]()
    for word in _WORD.findall(text):
        parts = word.split("-")
        # "forty-five", "two-step": numbers are read word by word.
        words += parts if len(parts) > 1 and any(part in numbers for part in parts) else [word]
    return ["and" if word == "&" else word for word in words]


def is_mark(token: Token) -> bool:
    """Whether a token is a punctuation mark."""
    return isinstance(token, str) and token in _MARKS


def tokens_of(sentence: str) -> list[Token]:
    """Words and amounts of a sentence in their order."""
    words, found, place = _units_first(words_of(sentence)), list[Token](), 0
    while place < len(words):
        token, used = _amount(words, place)
        same = _same_unit(words, place, found)
        found.append(token if same is None else same)
        place += used
    return found


def _units_first(words: list[str]) -> list[str]:
    """The words with "two backward steps" as "two steps backward"."""
    known, words = vocabulary(), list(words)
    for place in range(1, len(words) - 1):
        direction, unit = words[place], words[place + 1]
        counted = words[place - 1] in known.table["numbers"] or _NUMBER.fullmatch(words[place - 1])
        if counted and direction in known.words("directions") and unit in known.table["units"]["steps"]:
            words[place : place + 2] = unit, direction
    return words


def _same_unit(words: list[str], place: int, before: list[Token]) -> Amount | None:
    """The amount that "one" is in "one step to the left and one to the right"; None where it is none."""
    known = vocabulary().table
    earlier = next((token for token in reversed(before) if isinstance(token, Amount)), None)
    joined = place > 0 and words[place - 1] in ("and", "then", ",")
    if earlier is None or earlier.quantity not in ("steps", "length") or not joined:
        return None
    after = " ".join(words[place + 1 : place + 4])
    if words[place] not in known["numbers"] or not any(after.startswith(way) for way in known["ways"]):
        return None
    unit = earlier.value / max(_unit_count(earlier), 1e-9)
    return Amount(float(known["numbers"][words[place]]) * unit, earlier.quantity, words[place])


def _unit_count(amount: Amount) -> float:
    """How many of its unit an amount is: 2 of "two feet"."""
    number = _number(amount.said.split(), 0)
    return amount.value if number is None else number[0]


def _amount(words: list[str], place: int) -> tuple[Token, int]:
    """What begins at a word, and how many words it takes."""
    known = vocabulary()
    if words[place] in ("minus", "negative"):
        token, used = _amount(words, place + 1) if place + 1 < len(words) else ("", 0)
        if isinstance(token, Amount):
            return Amount(-token.value, token.quantity, f"{words[place]} {token.said}"), used + 1
    word, before = words[place], words[place - 1] if place else ""
    after = words[place + 1] if place + 1 < len(words) else ""
    if word in known.table["counts"] and before != "at" and after not in ("more", "again", "you", "you've"):
        return Amount(float(known.table["counts"][word]), "times", word), 1
    number = _number(words, place)
    if number is None:
        return word, 1
    value, used, rough, article = number
    rest = words[place + used :]
    skipped = 0
    explicit = not article
    while skipped < len(rest) and skipped < 2 and rest[skipped] in known.words("sizes") | {"of", "a", "an", "the"}:
        explicit = explicit or rest[skipped] in ("full", "whole", "complete")
        skipped += 1
    unit = rest[skipped] if skipped < len(rest) else ""
    if unit in known.table["things"] and not article:
        said = " ".join(words[place : place + used + skipped + 1])
        return Amount(value, "times", said, rough), used + skipped
    if unit not in known.units or (unit in known.table["revolutions"] and not explicit):
        said = words[place]
        return (Bare(value, said), 1) if used == 1 and _NUMBER.fullmatch(said) else (said, 1)
    if unit == "foot" and before in ("on", "with", "lift", "raise", "the", "your", "left", "right", "stand"):
        return words[place], 1
    end = place + used + skipped + 1
    if words[end : end + 3] in (["and", "a", "half"], ["and", "a", "quarter"]):
        value += known.table["fractions"][words[end + 2]]
        end += 3
    quantity, size = known.units[unit]
    if unit in ("metre", "meter") and (hundredths := _hundredths(words, end)) is not None:
        value, end = value + hundredths[0], end + hundredths[1]  # "one metre fifty"
    return Amount(value * size, quantity, " ".join(words[place:end]), rough), end - place


def _hundredths(words: list[str], place: int) -> tuple[float, int] | None:
    """Hundredths said behind a unit, and how many words they are; None where something of its own is counted there."""
    number = _number(words, place) if place < len(words) else None
    if number is None or number[3] or not 10 <= number[0] < 100:
        return None
    following = words[place + number[1]] if place + number[1] < len(words) else ""
    return None if following in vocabulary().units else (number[0] / 100.0, number[1])


def _number(words: list[str], place: int) -> tuple[float, int, bool, bool] | None:
    """Value, words used, whether it is rough, whether it is a mere article; None: no number begins here."""
    table = vocabulary().table
    numbers, fractions, articles, vague = (table[name] for name in ("numbers", "fractions", "articles", "vague"))

    def at(index: int) -> str:
        return words[index] if index < len(words) else ""

    first = at(place)
    if first in vague:
        return float(vague[first]), 1, True, False
    if first in articles and at(place + 1) in vague:
        return float(vague[at(place + 1)]), 2 + (at(place + 2) == "of"), True, False
    if first in fractions:
        return float(fractions[first]), 1, False, False
    if first in articles and at(place + 1) in fractions:
        return float(fractions[at(place + 1)]), 2, False, False
    if _NUMBER.fullmatch(first) and len(first) <= _LONGEST_NUMBER:
        value, used = float(first), 1
        if at(place + 1) == "and" and at(place + 2) in articles and at(place + 3) in fractions:
            return value + fractions[at(place + 3)], 4, False, False
        if at(place + 1) in ("hundred", "thousand"):
            return value * numbers[at(place + 1)], 2, False, False
        return value, used, False, False
    if first in articles and at(place + 1) in ("hundred", "thousand"):
        value, used = _named(words, place + 1)
        return value, used + 1, False, False
    if first in articles:
        return float(articles[first]), 1, False, True
    if first not in numbers:
        return None
    value, used = _named(words, place)
    following = at(place + used)
    if following in fractions and fractions[following] < 0.5 + 1e-9 and following != "half":
        return value * fractions[following], used + 1, False, False
    if following == "and" and at(place + used + 1) in articles and at(place + used + 2) in fractions:
        return value + fractions[at(place + used + 2)], used + 3, False, False
    if following == "point" and at(place + used + 1) in numbers:
        return float(f"{int(value)}.{numbers[at(place + used + 1)]}"), used + 2, False, False
    return value, used, False, False


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
        if word not in numbers:
            break
        value = float(numbers[word])
        if value >= 1000:
            total, current = total + max(current, 1.0) * value, 0.0
        elif value >= 100:
            current = max(current, 1.0) * value
        elif used and not (last >= 20 and value < 10) and last not in (100.0, 1000.0):
            break  # "two three" are two numbers
        else:
            current += value
        used, last = used + 1, value
    return total + current, used
