"""`Speed`: phrases that say how fast by a factor: "at half speed", "twice as fast", "by 20 percent"."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

from flexmotion.text.numbers import number_at
from flexmotion.text.vocabulary import vocabulary

GREATEST = 10.0
"""Factor of "as fast as you can"; the robot's pace limits it."""
LEAST = 0.05
"""Smallest factor: "by 100 percent" is no speed."""

_OWNERS = frozenset(["of", "the", "a", "your", "that", "this", "its", "normal", "usual", "present", "previous", "very"])


@dataclass(frozen=True)
class Speed:
    """A factor on the speed of a motion; `said`: the words for it."""

    factor: float
    said: str


@dataclass(frozen=True)
class Rate:
    """A speed with a unit: `value` in metres or radians a second; `said`: the words for it.

    Attributes:
        turns: whether it is of a turn [rad/s], else of a way [m/s].
        vague: the words name no one speed ("0.3 to 0.5 m/s", "a few metres a second").
    """

    value: float
    turns: bool
    said: str
    vague: bool = False


def speed_at(words: list[str], place: int) -> tuple[Speed, int] | None:
    """The speed that begins at a word, and how many words it takes; None where none begins."""
    found = _of_speed(words, place) or _as_fast(words, place) or _by(words, place)
    if found is None:
        return None
    factor, used = found
    said = " ".join(words[place : place + used])
    return Speed(min(max(factor, LEAST), GREATEST), said), used


def tells_speed(words: list[str]) -> bool:
    """Whether a speed may begin at a word that begins no number: "at a slow pace", "slower by half"."""
    return not _tell_speed().isdisjoint(words)


@lru_cache
def _tell_speed() -> frozenset[str]:
    """Words of which such a speed has at least one."""
    openings = (phrase.split()[0] for phrase in vocabulary().phrases("flat_out"))
    return frozenset(["by", *openings, *vocabulary().table["speed_nouns"]])


def _of_speed(words: list[str], place: int) -> tuple[float, int] | None:
    """As in "half the speed", "at a slow pace", "at double your speed"."""
    table = vocabulary().table
    start = place + (_at(words, place) in ("at", "with", "to", "in"))
    index, factor, share = start, None, _share(words, start)
    if share is not None:
        factor, used = share
        index += used
    while _at(words, index) in _OWNERS:
        index += 1
    if factor is None and _at(words, index) in table["rates"]:
        factor, index = float(table["rates"][_at(words, index)]), index + 1
    if factor is None or _at(words, index) not in table["speed_nouns"]:
        return None
    # "half a pace" is a step.
    if _at(words, index) == "pace" and start == place and "the" not in words[place:index]:
        return None
    return factor, index + 1 - place


def _as_fast(words: list[str], place: int) -> tuple[float, int] | None:
    """As in "twice as fast", "20 percent slower", "as fast as you can"."""
    table = vocabulary().table
    for phrase in vocabulary().phrases("flat_out"):
        length = len(phrase.split())
        if words[place : place + length] == phrase.split():
            return GREATEST, length
    share = _share(words, place)
    if share is None:
        return None
    factor, used = share
    after = words[place + used : place + used + 2]
    if len(after) == 2 and after[0] == "as" and after[1] in table["speeds"]:
        slow = float(table["speeds"][after[1]]) < 1.0
        return (1.0 / factor if slow else factor), used + 2
    if after[:1] and after[0] in ("faster", "quicker", "slower") and words[place + used - 1] == "percent":
        return (1.0 - factor if after[0] == "slower" else 1.0 + factor), used + 1
    return None


def _by(words: list[str], place: int) -> tuple[float, int] | None:
    """As in "slow down by half", "faster by 20 percent"."""
    if "by" not in words[place + 1 :]:
        return None
    for name, sign in (("slower", -1.0), ("faster", 1.0)):
        for phrase in vocabulary().phrases(name):
            length = len(phrase.split())
            if words[place : place + length] != phrase.split() or _at(words, place + length) != "by":
                continue
            share = _share(words, place + length + 1)
            if share is not None:
                return 1.0 + sign * share[0], length + 1 + share[1]
    return None


def _share(words: list[str], place: int) -> tuple[float, int] | None:
    """A factor in words or digits: "half", "a third", "double", "20 percent", "three times"."""
    table = vocabulary().table
    start = place + (_at(words, place) == "a" and _at(words, place + 1) in table["fractions"])
    word, used = _at(words, start), start - place + 1
    if word in table["fractions"] or word in table["multiples"]:
        return float(table["fractions"].get(word, table["multiples"].get(word))), used
    if word in table["counts"]:
        return float(table["counts"][word]), used
    number = number_at(words, place)
    unit = "" if number is None else _at(words, place + number.used)
    if number is None or number.rough or number.value < 0.0 or unit not in ("percent", "times"):
        return None
    return (number.value / 100.0 if unit == "percent" else number.value), number.used + 1


def _at(words: list[str], index: int) -> str:
    return words[index] if 0 <= index < len(words) else ""
