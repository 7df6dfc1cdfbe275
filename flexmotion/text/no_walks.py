"""`no_walk`, `unknown_way`, `stand_note`: words that a listener hears as a walk, and that ask for none ("let go")."""

from __future__ import annotations

import re
from functools import lru_cache

from flexmotion.text.amounts import Token
from flexmotion.text.manner_phrases import manner_phrases
from flexmotion.text.phrases import STAND, kinds, verbs, wordings
from flexmotion.text.sayings import NOTHING
from flexmotion.text.sides import sides
from flexmotion.text.vocabulary import vocabulary
from flexmotion.text.wording import STAND_IN, begins, plain, stem, stripped, taught

STAND_STILL = "stand still"
"""Words of a stand, as every listener knows them."""

_LETS_GO = re.compile(
    r"(?:let (?:(?:me|him|her|us|it|them|this|that|my \w+) )?go(?: (?:of .+|now|again))?"
    r"|set (?:me|it|him|her) free|free (?:me|him|her|us|it|my .+|yourself)"
    r"|give me (?:back )?my (?:hand|arm)(?: back)?)"
)
_AT_SOMEONE = re.compile(
    r"\b(?:at|on|over|into|through|past|before|ahead of|in front of)"
    r" (?:me|him|her|us|them|someone|somebody|people|everyone)\b"
)
_ADVERBS = frozenset(["very", "really", "so", "quite", "all"])
"""Beside those in "-ly", of what follows: "go completely limp"."""
_DETERMINERS = frozenset(["a", "an", "the", "your", "my", "some", "another", "this", "that"])


def stand_note(tokens: list[Token]) -> str | None:
    """What to tell of words that ask for a stand, and in which a listener may hear a walk; None for other words."""
    said = plain(stripped(tokens))
    if taught().get(said, STAND) not in (STAND, NOTHING):
        return None  # "look out of the window on your right"
    return next((note for pattern, note in _stands() if pattern.fullmatch(said)), None)


@lru_cache
def _stands() -> tuple[tuple[re.Pattern[str], str], ...]:
    return tuple((re.compile(pattern), note) for pattern, note in vocabulary().table["stands"].items())


def no_walk(words: list[str]) -> str | None:
    """Why a request in which a listener may hear a walk is none; None where it may be one."""
    known, text = vocabulary(), " ".join(words)
    if not words or text in taught():
        return None
    if _LETS_GO.fullmatch(text) or words[0] in known.words("releasing"):
        return "the robot holds on to nothing; say 'lower your arms'"
    if _leaves(words):
        whose = "you are" if {"me", "us"} & set(words) else "that is"
        return f"'away': the robot does not know where {whose}; say 'walk back' or 'walk forward'"
    if (place := _at_someone(words)) is not None:
        return f"{place!r}: the robot does not know where that is; say 'walk forward', or to which side"
    if _asks_less(words):
        return "how much is less? say it, as in 'walk 2 metres'"
    return None


def unknown_way(words: list[str]) -> str | None:
    """Why a verb of walking has a complement that tells neither how nor where to: "go limp", "run a test"; None: none.

    Args:
        words: of a request whose amounts have been read.
    """
    if words[:1] == [] or words[0] not in ("go", "run", "walk") or " ".join(words) in taught():
        return None
    other = _other_complement(words[1:], how=words[0] != "go")
    tries = f"say for example '{words[0]} forward'"
    return None if other is None else f"{other!r} is no way to walk or to run that is known; {tries}"


def _leaves(words: list[str]) -> bool:
    """Whether a walk is away from something, and no word tells in which direction that is."""
    known = vocabulary()
    place = words.index("away") if "away" in words else 0
    told = known.words("directions") | {"turning", "backing", "facing"}  # "without turning round" is backwards
    goes = place > 0 and words[place - 1] not in ("right", "straight", "far")
    return goes and words[0] in known.words("leaving") and not told & set(words)


def _at_someone(words: list[str]) -> str | None:
    """Where a walk is to go by words of somebody's place ("in front of me", "over him"); None: it names none."""
    known = vocabulary()
    if words[0] not in known.words("paths") | {"come", "move", "get"} or known.words("limbs") & set(words):
        return None  # "move your hand as if waving at someone"
    if _goes_to_gesture(words):
        return None
    found = _AT_SOMEONE.search(" ".join(words[1:]))
    return None if found is None else found[0]


def _asks_less(words: list[str]) -> bool:
    """Whether words ask for less of a walk or a turn, or less than some of it: "less walking", "walk less than"."""
    known = vocabulary()
    feet = known.words("paths") | known.words("turn_verbs")
    for place, word in enumerate(words):
        if word not in ("less", "fewer", "under", "below"):
            continue
        after = words[place + 1] if place + 1 < len(words) else ""
        counted = stem(after) in feet or known.units.get(after, ("",))[0] in ("steps", "angle")
        if counted or (after in ("", "than") and stem(words[0]) in feet):
            return True
    return False


def _other_complement(words: list[str], how: bool) -> str | None:
    """What follows a verb of walking and says neither how nor where to ("limp", "a test"); None: nothing such.

    Args:
        how: whether an adjective may say a manner: "walk sad", but no "go limp".
    """
    known = vocabulary()
    rest = list(words)
    degree = begins([*rest], 0, known.phrases("speed_degrees"))
    after = [] if degree is None else rest[len(degree.split()) :]
    if after and (after[0] in known.table["speeds"] or after[0].endswith("ly")):
        rest = after  # "dead slow", but no "walk dead"
    while rest and (rest[0].endswith("ly") or rest[0] in _ADVERBS or rest[0] in known.table["speeds"]):
        rest = rest[1:]
    if not rest:
        return None
    first, text = rest[0], " ".join(rest)
    if any(f"{text} ".startswith(f"{phrase} ") for phrase in known.phrases("amplifiers")):
        return None
    if first in _DETERMINERS:
        nouns = known.words("ways_nouns") | known.words("directions") | known.words("room_things")
        return None if nouns & set(rest) else text
    fits = first in known.words("ways_on") | known.words("directions") | known.words("hedges")
    fits = fits or (how and (first in known.words("ways_how") or any(one.manner for one in manner_phrases(first))))
    fits = fits or stem(first) in known.verbs or bool(sides(first)) or first.startswith(STAND_IN)
    return None if fits else text


def is_gesture(words: list[str]) -> bool:
    """Whether the first word that tells what to move with is a gesture's: "do a clap backwards", "go wave back"."""
    rest = words[1:] if _goes_to_gesture(words) else words
    feet = feet_verbs() | {"come", "steps"}
    gestures = gesture_verbs() | vocabulary().words("gesture_nouns")
    told = next((word for word in map(stem, rest) if word in feet | gestures), "")
    behind = re.search(r"\bbehind (?:your|the|its) back\b", " ".join(rest)) is not None
    return told in gestures or (behind and not told)


def _goes_to_gesture(words: list[str]) -> bool:
    """Whether a walk is only the way to say a gesture: "go wave at them"."""
    return words[0] in ("go", "come") and bool(words[1:]) and stem(words[1]) in gesture_verbs()


@lru_cache
def feet_verbs() -> frozenset[str]:
    """Verbs of walks and of turns."""
    known = vocabulary()
    feet = {verb.split()[0].lower() for kind in _of_feet() for verb in verbs(kind)}
    others = known.words("light_verbs") | {"take", "make", "back"}  # "behind your back"
    return frozenset(feet | known.words("paths") | known.words("turn_verbs")) - others


@lru_cache
def gesture_verbs() -> frozenset[str]:
    """Verbs that open wordings of gestures alone, and none of a walk, a turn or a stand: "clap", "nod"."""
    others = {STAND, *_of_feet()}
    taken = {wording.split()[0].lower() for kind in others for wording in wordings(kind)}
    gestures = {verb.split()[0].lower() for kind in kinds() if kind not in others for verb in verbs(kind)}
    return frozenset(gestures - taken) - vocabulary().words("light_verbs")


def _of_feet() -> tuple[str, ...]:
    """Kinds of walks and of turns."""
    return (*vocabulary().table["walks"], *vocabulary().table["turns"])
