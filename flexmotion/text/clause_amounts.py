"""`amounts_of`, `further_times`, `little_of`, `speed_of`: how much, how often and how fast a request says."""

from __future__ import annotations

import difflib
import math
from itertools import pairwise
from math import pi

from flexmotion.text.amounts import LEAST_BARE, MINUS, Amount, Bare, Token
from flexmotion.text.numbers import number_at
from flexmotion.text.paces import Speed
from flexmotion.text.spelling import LEAST_LIKENESS
from flexmotion.text.vocabulary import vocabulary
from flexmotion.text.wording import begins, plain, taught, taught_words


def amounts_of(tokens: list[Token]) -> tuple[Amount | None, int, bool, list[Token], list[str]]:
    """The amount that ends the motion, how often, whether that was said, the other tokens, amounts that are dropped."""
    known = vocabulary()
    hedges = known.words("hedges")
    first_word = next((token for token in tokens if isinstance(token, str)), "")
    turns = first_word in known.words("turn_verbs") or first_word in ("do", "make")
    amount: Amount | None = None
    times, counted = 1, False
    rest: list[Token] = []
    extra: list[str] = []
    for token in tokens:
        if isinstance(token, Bare) and turns and abs(token.value) >= LEAST_BARE:
            token = Amount(token.value * pi / 180.0, "angle", token.said)
            rest = rest[:-1] if rest[-1:] == ["a"] else rest
        if not isinstance(token, Amount):
            rest.append(token)
            continue
        if token.quantity == "time" and counted and (spent := _spent(rest)):
            # "Ten times in five seconds": the count is meant; only "ten times for five seconds" has both.
            extra.append(" ".join([*spent, token.said]))
            del rest[-len(spent) :]
            continue
        extra += [word for word in token.said.split() if word in known.words("sizes") - known.words("plain_sizes")]
        while (
            rest
            and rest[-1] in hedges
            and (token.quantity != "times" or rest[-1] not in ("around", "through"))
            and len(rest) > (1 if amount is None and rest[-1] == "only" else 0)
        ):
            rest.pop()
        if token.quantity == "times":
            extra += [token.said] if counted else []
            times, counted = (times, counted) if counted else (int(token.value), True)
        elif amount is None or (turns and token.quantity == "angle" and amount.quantity != "angle"):
            extra += [] if amount is None else [amount.said]
            amount = token
        else:
            extra.append(token.said)
    return amount, times, counted, rest, extra


def further_times(tokens: list[Token]) -> int | None:
    """How many more of what was done before words ask for that count nothing by name ("two more"); None: no such."""
    words = plain(tokens).split()
    another = words[:1] == ["another"]
    number = number_at(words, int(another)) if len(words) > another else None
    if number is None or number.article or number.rough or any(isinstance(token, Amount) for token in tokens):
        return None
    ends = words[another + number.used :] == ([] if another else ["more"])
    return int(number.value) if ends and number.value >= 2 and number.value == int(number.value) else None


def _spent(rest: list[Token]) -> list[str]:
    """The last words, where a time behind them is that of all repeats or of a pause: "in", "with a pause of"."""
    if rest[-1:] and rest[-1] in ("in", "within", "over", "during", "inside"):
        return [str(rest[-1])]
    pauses = vocabulary().words("pauses")
    place = next((at for at, token in enumerate(rest) if token in ("with", "and") and pauses & {*rest[at:]}), None)
    words = [] if place is None else [token for token in rest[place:] if isinstance(token, str)]
    return words if place is not None and len(words) == len(rest) - place else []


def signed(tokens: list[Token]) -> str | None:
    """A minus in front of an amount or a speed that takes none, with it; None where there is none."""
    for token, after in pairwise(tokens):
        if token in MINUS and not isinstance(after, str):
            return f"{token} {after.said}"
    return None


def is_count(amount: Amount) -> bool:
    """Whether an amount of times is a whole number from 1 on; other amounts always are fine."""
    return amount.quantity != "times" or (amount.value >= 1 and amount.value == int(amount.value))


def counts_nothing(tokens: list[Token]) -> bool:
    """Whether a number in words counts nothing that is known: "walk two", "walk two metrs"; "two hands" are counted.

    Behind a verb of the feet a number counts units alone: "walk two blocks" has none. Behind a noun it is a name ("bay
    six"), and "one" may stand for a noun ("wave one more").
    """
    known = vocabulary()
    if " ".join(token for token in tokens if isinstance(token, str)) in taught():
        return False
    feet = tokens[:1] != [] and tokens[0] in known.words("paths")
    uncounted = known.words("directions") | known.words("hedges") | known.words("limb_places")
    opens = known.verbs | known.words("directions") | known.words("hedges")
    numbers = known.table["numbers"]
    ways = known.words("directions") | {"to", "the", "your", "and", *numbers}
    if tokens[:1] and tokens[0] in numbers and tokens[1:] and {*tokens[1:]} <= ways:
        return True  # "two back", "one forward, one back"
    limbs = {limb for names in known.table["limb_groups"].values() for limb in names}
    for place, token in enumerate(tokens[1:], 1):
        if token not in known.table["numbers"] or tokens[place - 1] not in opens:
            continue
        after = tokens[place + 1 : place + 3]
        if limbs & set(after) or (token == "one" and not (feet and place == 1)):
            continue
        if feet or not after or after[0] in uncounted or after[0] not in taught_words():
            return True
    return False


MEASURES = ("met", "centim", "millim", "degree", "radian")
"""Units that mean nothing else begin so; seconds, feet, turns and steps are also words of motions."""


def unread_number(tokens: list[Token]) -> str | None:
    """Why a unit lacks a number: a misspelt one is in front of it ("thre metres"), or none; None: no unit lacks one.

    Args:
        tokens: what is left of a request once its amounts are read.
    """
    known = vocabulary()
    numbers = [word for word in known.table["numbers"] if len(word) > 2]
    for word, unit in pairwise(tokens):
        if not isinstance(word, str) or not isinstance(unit, str) or unit not in known.units:
            continue
        if len(word) < 3 or word in taught_words() or word in known.verbs or word in numbers:
            continue
        if meant := difflib.get_close_matches(word, numbers, 1, LEAST_LIKENESS):
            return f"{word!r}: expected a number; try: {meant[0]}"
    for unit in tokens:
        if isinstance(unit, str) and unit in known.units and unit.startswith(MEASURES):
            return f"{unit!r} of what number? expected one, as in 'walk 2 metres'"
    return None


def little_of(tokens: list[Token]) -> tuple[Amount | None, list[Token]]:
    """The amount of a walk or a turn "a bit" and the other tokens; None where there is none, or it is no amount.

    "A little faster" is a change of speed, "wave a little" a manner.
    """
    known = vocabulary()
    first = next((token for token in tokens if isinstance(token, str)), "")
    turns, walks = first in known.words("turn_verbs"), first in known.words("walk_verbs")
    for place in range(1, len(tokens)):
        phrase = begins(tokens, place, known.phrases("little"))
        if phrase is None:
            continue
        end = place + len(phrase.split())
        following = tokens[end] if end < len(tokens) else ""
        after = tokens[end + 1] if end + 1 < len(tokens) else ""
        if following in ("more", "further", "farther") and not (isinstance(after, str) and after[-2:] in ("ly", "er")):
            end, following = end + 1, after  # "a bit more to the left"
        changes = isinstance(following, str) and (following in known.table["speeds"] or following[-2:] in ("er", "ly"))
        if not (turns or walks) or changes or following in ("more", "less"):
            return None, tokens
        rest = [*tokens[:place], *tokens[end:]]
        if turns:
            degrees = float(known.table["little_turn"])
            return Amount(degrees * pi / 180.0, "angle", phrase, rough=True), rest
        return Amount(float(known.table["little_walk"]), "length", phrase, rough=True), rest
    return None, tokens


def degree_of(words: list[str]) -> str:
    """The words that say how large a gesture is to be ("a little", "very deeply"); empty where none do."""
    known = vocabulary()
    for place in range(1, len(words)):
        if phrase := begins([*words], place, known.phrases("degrees")):
            end = place + len(phrase.split())
            following = words[end] if end < len(words) else ""
            if following in known.words("degree_more"):
                return f"{phrase} {following}"
            if not following or following in known.words("degree_ends"):
                return phrase
    for place in range(len(words)):
        if phrase := begins([*words], place, known.phrases("degree_adverbs")):
            return phrase
    return ""


def _ending(tokens: list[Token], phrases: tuple[str, ...]) -> str | None:
    """The phrase that some tokens end with; the longest one."""
    return next((phrase for phrase in phrases if tokens[-len(phrase.split()) :] == phrase.split()), None)


def speed_of(tokens: list[Token]) -> tuple[float, str, list[Token]]:
    """The factor that adverbs put on the speed, these adverbs, and the tokens without them."""
    known = vocabulary()
    speeds: dict[str, float] = known.table["speeds"]
    said = [token for token in tokens if isinstance(token, Speed)]
    factor, manner = math.prod(token.factor for token in said), [token.said for token in said]
    tokens = [token for token in tokens if not isinstance(token, Speed)]
    words = [token for token in tokens if isinstance(token, str)]
    if not any(word in speeds for word in words) or " ".join(words) in taught() or words[:1] == ["run"]:
        return factor, " ".join(manner), tokens
    rest: list[Token] = []
    amplifiers = (*known.phrases("speed_degrees"), *known.phrases("amplifiers"))
    for token in tokens:
        if isinstance(token, str) and token in speeds:
            share, manner = speeds[token], [*manner, token]
            while amplifier := _ending(rest, amplifiers):
                del rest[-len(amplifier.split()) :]
                manner[-1] = f"{amplifier} {manner[-1]}"
                strong, weak = amplifier in known.words("strong"), amplifier in known.words("weak")
                share = share ** (2.0 if strong else 0.5 if weak else 1.0)
            factor *= share
        else:
            rest.append(token)
    return factor, " ".join(manner), rest
