"""`Amount`: numbers with their units in sentences, in words and in digits."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, replace
from functools import lru_cache

from flexmotion.text.numbers import is_digits, number_at, pi_of
from flexmotion.text.paces import Rate, Speed, speed_at, tells_speed
from flexmotion.text.vocabulary import Quantity, vocabulary

_SYMBOLS = {
    "π": " pi ",
    "°": " degrees ",
    "º": " degrees ",
    "½": " half ",
    "¼": " quarter ",
    "¾": " three quarters ",
    "×": " times ",
    "%": " percent ",
    "→": " then ",
    "=>": " then ",
    "->": " then ",
}
_DIGIT = re.compile(r"\d")
_MINUS = re.compile(r"(?<![^\s(])(?:\u2212\s*|[-\u2013])(?=[\d.])")
_MINUS_WORD = re.compile(r"(?<![^\s(])(?:\u2212\s*|[-\u2013])(?=([^\W\d_]+|[½¼¾]))")
"""A minus sign stands in front of its number, whatever character it is; a dash between two spaces is punctuation."""
_FRACTION = re.compile(r"(?<![\w./])(?:(\d+) )?([1-9])/([234568])(?![\w/])")
_MARKS = frozenset(",.;:!?&")

MINUS = ("minus", "negative")
"""Words of the sign, in front of a number."""

_PER_SIZES = (1.0, 60.0, 3600.0)
"""Times of a speed: a second, a minute, an hour; "a while" and "a moment" are none [s]."""
_LATER = ("after", "later", "before", "then", "afterwards", "beforehand")
"""Words behind a time that begins or ends there: "walk two metres, a second after that wave"."""

_JOINTS = ("and", "or", "to", "of", "more", "then", "further", "extra", "additional", "point", "dozen")

_JOINED_ONCE = ("more", "again", "you", "you've")
"""Words behind "once" that make it another phrase."""

LEAST_BARE = 15.0
"""A number without a unit behind "turn" is an angle from here on [degrees]; a smaller one in words is a word."""


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


Token = str | Amount | Bare | Speed | Rate
"""A word or a punctuation mark, an amount, a number without unit, a factor on the speed, or a speed with a unit."""


def words_of(sentence: str) -> list[str]:
    """Words, numbers and punctuation marks of a sentence, in lower case."""
    text = sentence.lower().replace("’", "'").replace("‘", "'")
    text = _MINUS_WORD.sub(_minus, _MINUS.sub("-", text))
    for symbol, name in _SYMBOLS.items():
        text = text.replace(symbol, name)
    if _DIGIT.search(text):
        text = _digits_read(text)
    numbers, words = vocabulary().table["numbers"], list[str]()
    for word in _word().findall(text):
        word = "".join(word.split())  # "m / s"
        parts = word.split("-")
        # "forty-five", "two-step": numbers are read word by word.
        words += parts if len(parts) > 1 and any(part in numbers for part in parts) else [word]
    return ["and" if word == "&" else word for word in words]


@lru_cache
def _word() -> re.Pattern[str]:
    """A number, a unit of a speed ("m/s"), a part of pi ("pi/2"), a word or a punctuation mark."""
    units = vocabulary().table["units"]
    ways, times = (
        "|".join(sorted((unit for name in names for unit in units[name]), key=len, reverse=True))
        for names in (("length", "angle", "steps"), ("time",))
    )
    return re.compile(
        r"(?<![\w.])-(?:\d+(?:\.\d+)?|\.\d+)|\d+(?:\.\d+)?|\.\d+"
        rf"|(?:{ways})\s?/\s?(?:{times})(?:[/²]\w*)?(?!\w)"  # "m/s²" is one that no speed has
        r"|[+/]\s*pi\b(?:\s*/\s*\w+(?:\.\d+)?)?"  # no number: refused by name
        r"|(?<![^\W\d_])pi\s*/\s*(?:\w+(?:\.\d+)?)?"
        r"|[^\W\d_]+(?:['\-][^\W\d_]+)*|[,.;:!?&]"
    )


def _digits_read(text: str) -> str:
    """Text with fractions as decimals, numbers without commas, and the marks for inches and feet in words."""
    # "1,000" and "2,5" are numbers, "1, 2" are two.
    text = _FRACTION.sub(lambda found: f"{int(found[1] or 0) + int(found[2]) / int(found[3]):.4g}", text)
    text = re.sub(r"(?<=\d),(?=\d{3}\b)", "", text)
    text = re.sub(r"(?<=\d),(?=\d{1,2}\b)", ".", text)
    for mark, unit in (('"', "inches"), ("'", "feet")):
        text = re.sub(rf"(?<=\d)\s?{mark}(?!\w)", f" {unit} ", text)
    return text


def _minus(found: re.Match[str]) -> str:
    """A sign in front of a word as "minus", where the word says a number."""
    table = vocabulary().table
    counts = found[1] in "½¼¾" or found[1] in table["numbers"] or found[1] in table["fractions"]
    return "minus " if counts else found[0]


def is_mark(token: Token) -> bool:
    """Whether a token is a punctuation mark."""
    return isinstance(token, str) and token in _MARKS


def tokens_of(sentence: str) -> list[Token]:
    """Words and amounts of a sentence in their order."""
    words, found, place = _units_first(words_of(sentence)), list[Token](), 0
    fast = tells_speed(words)
    while place < len(words):
        if not fast and not _counts(words[place]):
            found.append(words[place])
            place += 1
            continue
        token, used = _same_unit(words, place, found) or speed_at(words, place) or _amount(words, place)
        found.append(token)
        _join_range(found)
        place += used
        if (rate := _rate_at(words, place, found)) is not None:
            found[-1:], place = [rate], place + 2
        if isinstance(found[-1], Rate):
            _join_rates(found)
            while len(found) > 1 and found[-2] in _rate_words():
                del found[-2]
    return found


def _rate_at(words: list[str], place: int, found: list[Token]) -> Rate | None:
    """The speed that the last amount is with the two words behind it ("0.3 metres per second"); None: it is none."""
    amount, (per, time, after) = found[-1], [*words[place : place + 3], "", "", ""][:3]
    if not isinstance(amount, Amount) or amount.quantity not in ("length", "angle"):
        return None
    size, counted = _per_size(time), after in ("time", "step")  # "a second time"
    if per not in ("per", "a", "an", "each", "every") or size is None or counted:
        return None
    if per in ("a", "an") and after in _LATER and not _leads(found[:-1]):
        return None
    return Rate(amount.value / size, amount.quantity == "angle", f"{amount.said} {per} {time}", amount.rough)


def _per_size(unit: str) -> float | None:
    """Length of the time that a speed is of [s]; None for a unit that none is of."""
    quantity, size = vocabulary().units.get(unit, ("", 0.0))
    return size if quantity == "time" and size in _PER_SIZES else None


def _leads(before: list[Token]) -> bool:
    """Whether tokens end with words that only a speed follows: "at", "at a speed of about"."""
    for token in reversed(before):
        if token in ("at", *vocabulary().table["speed_nouns"]):
            return True
        if token not in _rate_words():
            return False
    return False


def _speed_unit(word: str) -> tuple[float, bool] | None:
    """Size of a unit of a speed ("m/s", "mph"), and whether it is one of a turn; None for another word."""
    way, _, time = vocabulary().table["speed_units"].get(word, word).partition("/")
    quantity, length = vocabulary().units.get(way, ("", 0.0))
    size = _per_size(time)
    return None if size is None or quantity not in ("length", "angle") else (length / size, quantity == "angle")


def _join_rates(found: list[Token]) -> None:
    """Replace "0.3 to 0.5 m/s", "between 0.3 and 0.5 m/s" at the end of the tokens by one speed that is none."""
    rate = found[-1]
    joint = found[-2] if found[-2:-1] and found[-2] in ("or", "to", "and") else "-"
    first = len(found) - (2 if joint == "-" else 3)
    lower = found[first] if first >= 0 else ""
    if not isinstance(rate, Rate) or not (
        isinstance(lower, Bare | Rate) or (joint != "-" and lower in vocabulary().table["numbers"])
    ):
        return
    said = lower if isinstance(lower, str) else lower.said
    between = joint if joint == "-" else f" {joint} "
    found[first:] = [replace(rate, said=f"{said}{between}{rate.said}", vague=True)]
    if found[-2:-1] == ["between"]:
        del found[-2]


@lru_cache
def _rate_words() -> frozenset[str]:
    """Words in front of a speed with a unit that say no more of it: "at a speed of about"."""
    return frozenset(["at", "with", "to", "of", "a", "the", "about", "around", *vocabulary().table["speed_nouns"]])


@lru_cache
def _counting() -> frozenset[str]:
    """Words with which an amount or a factor can begin."""
    known = vocabulary()
    tables = ("numbers", "fractions", "multiples", "counts", "articles", "vague")
    return frozenset(word for name in tables for word in known.table[name]) | {
        "a",
        "dozen",
        "half",
        "minus",
        "negative",
    }


def _counts(word: str) -> bool:
    """Whether an amount or a factor can begin with a word; most words of a sentence are not looked at further."""
    return not word[:1].isalpha() or word in _counting() or pi_of(word) is not None


def _join_range(found: list[Token]) -> None:
    """Replace "two or three steps", "between 30 and 40 degrees" at the end of the tokens by one rough amount."""
    amount = found[-1]
    if len(found) < 3 or not isinstance(amount, Amount) or found[-2] not in ("or", "to", "and"):
        return
    lower = found[-3]
    between = found[-4:-3] == ["between"]
    low = lower.value if isinstance(lower, Bare) else vocabulary().table["numbers"].get(lower)
    if low is None or (found[-2] == "and" and not between):
        return
    high = _unit_count(amount)
    said = f"{lower if isinstance(lower, str) else lower.said} {found[-2]} {amount.said}"
    share = (math.ceil(0.5 * (low + high)) if high == int(high) else 0.5 * (low + high)) if between else high
    found[-4 if between else -3 :] = [Amount(amount.value * share / max(high, 1e-9), amount.quantity, said, rough=True)]


def _units_first(words: list[str]) -> list[str]:
    """The words with "two backward steps", "two slow steps", "two lateral steps" as "two steps backward" and so on.

    What says a size alone ("two big steps") stays in the amount.
    """
    known, words = vocabulary(), list(words)
    for place in range(1, len(words) - 1):
        direction, unit = words[place], words[place + 1]
        if unit not in known.table["units"]["steps"]:
            continue
        counted = words[place - 1] in known.table["numbers"] or is_digits(words[place - 1])
        qualifies = direction in known.words("directions") or (
            direction.isalpha() and direction not in _no_directions()
        )
        if counted and qualifies:
            words[place : place + 2] = unit, known.table["adverbs"].get(direction, direction)
    return words


@lru_cache
def _no_directions() -> frozenset[str]:
    """Words between a number and "steps" that say no direction."""
    known = vocabulary()
    others = known.words("sizes") | known.verbs | known.words("hedges")
    return frozenset(others).union(
        known.units, _JOINTS, *(known.table[name] for name in ("numbers", "articles", "fractions"))
    )


def _same_unit(words: list[str], place: int, before: list[Token]) -> tuple[Amount, int] | None:
    """An amount without its unit, which is that of the one before, and how many words it takes; None where it is none.

    As in "one step to the left and one to the right", "30 degrees left, then right 60", "two steps, and another one".
    """
    known = vocabulary()
    earlier = next((token for token in reversed(before) if isinstance(token, Amount)), None)
    if earlier is None or place == 0:
        return None
    another = words[place] == "another"
    number = number_at(words, place + another) if place + another < len(words) else None
    if number is None or number.article or not number.value:
        return None
    end = place + another + number.used
    more = another or words[end : end + 1] == ["more"]
    end += more and not another
    joints = ("and", "then", "plus", *_MARKS)
    ends = end == len(words) or words[end] in joints
    follows = words[place - 1] in joints
    behind = place > 1 and words[place - 1] in known.words("directions") and words[place - 2] in joints and ends
    after = f"{' '.join(words[end : end + 3])} "
    way = follows and any(after.startswith(f"{way} ") for way in (*known.table["ways"], "with"))
    if not (way or behind or (follows and more and ends)):
        return None
    unit = earlier.value / max(_unit_count(earlier), 1e-9)
    name = earlier.said.split()[-1]
    if earlier.quantity == "angle":
        if name in known.table["revolutions"] or name not in known.units:
            return None  # "half a turn left, then one right"
    elif number.value >= LEAST_BARE or (earlier.quantity == "times" and not more):
        return None  # "two steps, then 90 left"
    return Amount(number.value * unit, earlier.quantity, " ".join(words[place:end]), number.rough), end - place


def _unit_count(amount: Amount) -> float:
    """How many of its unit an amount is: 2 of "two feet"."""
    number = number_at(amount.said.split(), 0)
    return amount.value if number is None else number[0]


def _amount(words: list[str], place: int) -> tuple[Token, int]:
    """What begins at a word, and how many words it takes."""
    known = vocabulary()
    if words[place] in MINUS:
        token, used = _amount(words, place + 1) if place + 1 < len(words) else ("", 0)
        if isinstance(token, Amount):
            return Amount(-token.value, token.quantity, f"{words[place]} {token.said}"), used + 1
        if isinstance(token, Bare):
            return Bare(-token.value, f"{words[place]} {token.said}"), used + 1
        if isinstance(token, Rate):
            return replace(token, value=-token.value, said=f"{words[place]} {token.said}"), used + 1
    word, before = words[place], words[place - 1] if place else ""
    after = words[place + 1] if place + 1 < len(words) else ""
    if word in known.table["counts"] and before != "at" and (word != "once" or after not in _JOINED_ONCE):
        return Amount(float(known.table["counts"][word]), "times", word), 1
    number = number_at(words, place)
    if number is None:
        return word, 1
    value, used, rough, article = number
    rest = words[place + used :]
    skipped = 0
    explicit = not article
    while skipped < len(rest) and skipped < 3 and rest[skipped] in known.words("sizes") | {"of", "a", "an", "the"}:
        explicit = explicit or rest[skipped] in ("full", "whole", "complete")
        skipped += 1
    unit = rest[skipped] if skipped < len(rest) else ""
    if unit in known.table["things"] and not article:
        said = " ".join(words[place : place + used + skipped + 1])
        return Amount(value, "times", said, rough), used + skipped
    if (speed := _speed_unit(unit)) is not None:
        end = place + used + skipped + 1
        return Rate(value * speed[0], speed[1], " ".join(words[place:end]), rough), end - place
    if unit not in known.units or (unit in known.table["revolutions"] and not explicit):
        said = " ".join(words[place : place + used])
        named = words[place] in known.table["numbers"] and value >= LEAST_BARE and not rough
        of_pi = pi_of(words[place + used - 1]) is not None
        return (Bare(value, said), used) if named or is_digits(said) or of_pi else (words[place], 1)
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
    number = number_at(words, place) if place < len(words) else None
    if number is None or number[3] or not 10 <= number[0] < 100:
        return None
    following = words[place + number[1]] if place + number[1] < len(words) else ""
    return None if following in vocabulary().units else (number[0] / 100.0, number[1])
