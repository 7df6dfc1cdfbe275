"""`completed`: a request that leaves out what the one before it says: "wave with the right hand, then the left"."""

from __future__ import annotations

import re
from dataclasses import replace
from functools import lru_cache

from flexmotion.text.amounts import Amount
from flexmotion.text.clause import UNITS, Asks, Clause
from flexmotion.text.numbers import number_at
from flexmotion.text.refusals import needs_head
from flexmotion.text.sides import LEFT, mirrored, sides
from flexmotion.text.vocabulary import vocabulary

OTHER = "other"
"""The side that was not meant before."""
BACK, FORWARD = "back", "forward"
"""Ways of a walk that words leave out but for the direction; of a turn the first is the other side."""
_LOOKS = frozenset(["up", "down", "ahead", "forward", "forwards", "straight", "back", "behind"])
"""Directions of a look beside left and right; a walk takes some of them as well."""


def named_side(words: list[str]) -> str | None:
    """The side in words that say nothing but a side ("now the other hand"); None where they say more, or no side."""
    known = vocabulary()
    if not words or not set(words) <= known.words("refers"):
        return None
    named = sides(" ".join(words))
    if len(named) == 1:
        return min(named)
    return OTHER if not named and known.words("other") & set(words) else None


def named_way(words: list[str]) -> str | None:
    """`BACK` or `FORWARD` in words that say nothing but to do the same that way; None where they say more, or none."""
    known = vocabulary()
    ways = {way for way, name in ((BACK, "backward"), (FORWARD, "onward")) if known.words(name) & set(words)}
    others = known.words("refers") | known.words("backward") | known.words("onward")
    return ways.pop() if len(ways) == 1 and "same" in words and set(words) <= others else None


def with_side(text: str, side: str) -> str:
    """The words of a motion, to another side, with another hand, or of a walk or a turn forward or back."""
    named, known = sides(text), vocabulary()
    if side in (BACK, FORWARD):
        return mirrored(text) if text.split()[0] in known.words("turn_verbs") else f"walk {side}"
    if len(named) == 1:
        return text if side in named else mirrored(text)
    if text.split()[:1] and text.split()[0] in known.words("walk_verbs"):
        if side != OTHER:
            return f"walk to the {side}"
        return "walk forward" if known.words("backward") & set(text.split()) else "walk back"
    return f"{text} with the {LEFT if side == OTHER else side} hand"


def other_limb(text: str) -> str | None:
    """The limb whose other one a motion is asked for with ("wave with the other hand"); None where its side is told."""
    found = _other_limb().search(text)
    return None if found is None or sides(text) or "one" in text.lower().split() else found[1].lower()


def with_limb(text: str, side: str) -> str:
    """The words with a side in place of "other": "wave with the left hand"."""
    return _other_limb().sub(rf"{side} \1", text)


@lru_cache
def _other_limb() -> re.Pattern[str]:
    groups: dict[str, list[str]] = vocabulary().table["limb_groups"]
    return re.compile(rf"\b(?:other|opposite) ({'|'.join([*groups['arm'], *groups['leg']])})\b", re.IGNORECASE)


def is_repeated(words: list[str]) -> bool:
    """Whether words of a side ask for the last motion once more: "again with the left hand", "the other way"."""
    again = vocabulary().words("other") | {"same", "again", "more", "repeat", "redo"}
    return bool(again & set(words)) or words[-1:] == ["one"]  # "now the left one"


def completed(clause: Clause, words: list[str], before: Clause | None, goes_on: bool = False) -> Clause:
    """The request, with what it leaves out.

    Args:
        words: all words of the clause, without fillers.
        before: request before it in the sentence; None: it is the first.
        goes_on: it is the first, and opens with "and".
    """
    side = named_side(words)
    asked = before is not None and before.asks is Asks.MOTION and before.refusal is None and not before.forbidden
    if clause.forbidden and asked and before is not None and (other := named_side(clause.text.split())) is not None:
        return replace(clause, text=with_side(before.text, other))  # "wave, but not with the left hand"
    paced = clause.rate is not None and not clause.rate.vague and not clause.text and clause.joint == "then"
    if before is not None and asked and paced:  # "walk at 0.3 m/s, then at 0.5 m/s", as "then faster"
        return replace(_like(clause, before, before.text), amount=clause.amount, times=1, counted=False)
    if clause.refusal is not None and UNITS in clause.refusal:
        return clause  # "wave for 3 seconds, then right 5"
    back = goes_on and " ".join(words) in vocabulary().words("returns_turned")
    if (way := BACK if back else named_way(words)) is not None and (before is None or _goes(before)):
        if before is None:
            return replace(clause, text="", asks=Asks.AGAIN, refusal=None, side=way, more=False)
        if asked:
            return _like(clause, before, with_side(before.text, way))
    with_hand = clause.amount is not None and clause.amount.quantity == "time" and before is not None
    if side is not None and (clause.amount is None or (with_hand and before is not None and not _goes(before))):
        if before is None and (goes_on or is_repeated(words)):
            return replace(clause, text="", asks=Asks.AGAIN, refusal=None, side=side, more=False)
        if before is not None and asked:
            return _like(clause, before, with_side(before.text, side))
        return clause
    if before is not None and asked and clause.verbless and (counted := _counted(clause, before)) is not None:
        return replace(clause, amount=counted, times=1, counted=False)  # "step back once, then forward twice"
    if before is not None and asked and clause.verbless and needs_head(before.text.split()):
        return _looking_on(clause, words, before)
    if before is not None and asked and _returns(clause, before):
        return _like(clause, before, with_side(before.text, OTHER))
    return clause


def corrected(clause: Clause, wrong: Clause) -> Clause:
    """A request that corrects another one: what it does not say is as in that one ("two steps, sorry, three steps").

    A walk that corrects a walk, or a turn a turn, keeps the amount: "walk one metre forward, no, backward".
    """
    unmeasured = clause.asks is Asks.MOTION and clause.amount is None and clause.rate is None and clause.refusal is None
    if not clause.verbless:
        keeps = unmeasured and not clause.counted and not clause.until_told and _are_alike(clause, wrong)
        return replace(clause, amount=wrong.amount) if keeps else clause
    alike = clause.amount is not None and wrong.amount is not None and clause.amount.quantity == wrong.amount.quantity
    if alike and not sides(clause.said):
        return replace(wrong, said=clause.said, amount=clause.amount)
    if clause.amount is None and len(sides(clause.text)) == 1:
        return _like(clause, wrong, with_side(wrong.text, min(sides(clause.text))))
    return _like(clause, wrong, clause.text) if unmeasured and _are_alike(clause, wrong) else clause


def _are_alike(clause: Clause, wrong: Clause) -> bool:
    """Whether two requests are both walks or both turns, of which the second has an amount."""
    known = vocabulary()
    first, second = (one.text.split()[0] if one.text else "" for one in (clause, wrong))
    turns = known.words("turn_verbs")
    walks = known.words("walk_verbs") - turns - {"take", "make", "do"}
    return wrong.amount is not None and any({first, second} <= verbs for verbs in (walks, turns))


def _like(clause: Clause, before: Clause, text: str) -> Clause:
    """The clause as a motion with these words, as much of it as it says, or as of the one before."""
    counted = _counted(clause, before)
    return replace(
        clause,
        text=text,
        asks=Asks.MOTION,
        amount=counted or clause.amount or before.amount,
        times=1 if counted else clause.times if clause.counted else before.times,
        counted=counted is None and (clause.counted or before.counted),
        speed=before.speed,
        refusal=None,
    )


def _counted(clause: Clause, before: Clause) -> Amount | None:
    """As many as a request counts of what the one before it counts: "step left twice, then right once"."""
    if before.amount is None or " times" not in before.amount.said or not clause.counted or clause.amount is not None:
        return None
    number = number_at(before.amount.said.split(), 0)
    if number is None:
        return None
    value = before.amount.value / number.value * clause.times
    return replace(before.amount, value=value, said=f"{clause.times} times")


def _goes(clause: Clause) -> bool:
    """Whether a request is one of walking or turning, by its first word."""
    known = vocabulary()
    return clause.text.split()[:1] != [] and clause.text.split()[0] in known.words("walk_verbs") | known.words(
        "turn_verbs"
    )


def _looking_on(clause: Clause, words: list[str], before: Clause) -> Clause:
    """Another direction of a look, for as long as it says itself: "look up, then down for three seconds"."""
    if clause.amount is not None and clause.amount.quantity not in ("time", "times"):
        return clause
    named, directions = sides(" ".join(words)), [word for word in words if word in _LOOKS]
    thing = begins_with_place(words)
    if not (named or directions or thing):
        return clause
    if thing and not named:
        return replace(clause, text=f"look {' '.join(words)}", asks=Asks.MOTION, refusal=None, needs_head=True)
    text = f"look {' '.join([*directions, *sorted(named)])}"
    if len(named) == 1 and not directions and sides(before.text):
        text = with_side(before.text, min(named))
    return replace(clause, text=text, asks=Asks.MOTION, refusal=None, needs_head=True)


def begins_with_place(words: list[str]) -> bool:
    """Whether words are a place to look at whose direction is known: "at the floor"."""
    text = f" {' '.join(words)} "
    return words[:1] == ["at"] and any(f" {phrase} " in text for phrase in vocabulary().phrases("gaze_words"))


def _returns(clause: Clause, before: Clause) -> bool:
    """Whether a walk goes back what the one before it went ahead, or a turn what the one before it turned."""
    known = vocabulary()
    if before.text.split()[:1] != [] and before.text.split()[0] in known.words("turn_verbs"):
        return clause.amount is None and len(sides(before.text)) == 1 and clause.text in known.words("returns_turned")
    returns = clause.asks is Asks.MOTION and clause.amount is None and clause.text in known.words("returns")
    walked = before.amount is not None and before.amount.quantity in ("length", "steps", "time")
    return returns and walked and before.text.split()[:1] != [] and before.text.split()[0] in known.words("walk_verbs")
