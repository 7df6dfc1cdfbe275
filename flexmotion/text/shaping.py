"""`shaped`: the words of a request as a listener knows them: with a verb, "turn around" with its angle."""

from __future__ import annotations

from itertools import takewhile
from math import pi

from flexmotion.text.amounts import Amount
from flexmotion.text.sides import sides
from flexmotion.text.vocabulary import vocabulary
from flexmotion.text.wording import begins, stem, taught

TO_WHICH_SIDE = "turning: to the left or to the right?"
"""Refusal of a turn without a side."""


def shaped(
    words: list[str], amount: Amount | None, times: int, counted: bool
) -> tuple[list[str], Amount | None, str | None]:
    """Words as a listener knows them: verbless requests get their verb, "turn around" its angle.

    Returns:
        Words, amount, and why the request cannot be done (None: no reason).
    """
    known = vocabulary()
    text = " ".join(words)
    quantity = None if amount is None else amount.quantity
    whirls = words[:1] in (["spin"], ["revolve"], ["whirl"])
    spins = whirls or words[:1] in (["rotate"], ["turn"]) and bool({"around", "round"} & set(words))
    if counted and amount is None and spins:
        # "spin around once" is a whole turn
        given = Amount(2 * pi * times, "angle", f"{times} times around")
        return turning_words(text), given, None
    if any(text == phrase or text.startswith(phrase + " ") for phrase in known.phrases("around")):
        wanted = amount if quantity in ("angle", "time") else Amount(pi, "angle", "around")
        return turning_words(text), wanted, None
    verb = words[0] if words and words[0] in known.verbs else None
    arm = verb == "move" and bool(known.words("limbs") & set(words))  # "move your left arm up by 20 degrees"
    if words[:3] == ["turn", "to", "face"] and len(sides(text)) == 1:
        return turning_words(text), amount, None
    if (
        quantity == "angle"
        and not arm
        and (verb is None or verb in known.words("walk_verbs") | known.words("turn_verbs"))
    ):
        full = amount is not None and abs(amount.value) % pi < 1e-6
        if len(sides(text)) != 1 and not full:
            return words, amount, TO_WHICH_SIDE
        return turning_words(text), amount, None
    direction = [word for word in words if word in known.words("directions")]
    if verb == "back" and quantity in ("steps", "length"):
        words = ["step", *words]
    elif not has_verb(words) and (amount is not None or text in known.words("directions")):
        start = "step" if quantity == "steps" else "walk"
        words = [start, *(words or ["forward"])]
    elif verb in ("take", "make", "do") and quantity in ("steps", "length"):
        words = ["step", *words[1:]]
    if words[:1] and words[0] in known.words("walk_verbs") and quantity in ("steps", "length") and not direction:
        named = destinations(words)
        if len(words) == 1 and words[0] not in ("back", "retreat", "reverse"):
            words = [words[0], "forward"]
        elif named and " ".join(words[1:]) == named[0]:
            words = [words[0], "forward", *words[1:]]
    return words, amount, None


def turning_words(text: str) -> list[str]:
    """A turn to the side that is named; to the right without one, as after half or whole turns it does not matter."""
    side = sides(text)
    return ["turn", "to", "the", min(side) if len(side) == 1 else "right"]


def has_verb(words: list[str]) -> bool:
    """Whether a word is a verb, also in the third person ("the subject advances")."""
    verbs = vocabulary().verbs
    return any({word, word.removesuffix("s"), word.removesuffix("es"), stem(word)} & verbs for word in words)


def destinations(words: list[str]) -> list[str]:
    """Places that a request of walking names; the robot knows none."""
    known = vocabulary()
    feet = known.words("walk_verbs") | known.words("turn_verbs")
    if not words or words[0] not in feet or words[0] in ("take", "make", "do"):
        return []
    prepositions = sorted(known.words("destinations"), key=lambda phrase: -len(phrase.split()))
    for place in range(2 if words[:2] == ["back", "up"] else 1, len(words)):
        for phrase in prepositions:
            length = len(phrase.split())
            if words[place : place + length] != phrase.split():
                continue
            rest = [
                w for w in words[place + length :] if w not in ("the", "a", "an", "my", "your", "that", "this", "of")
            ]
            own = known.words("undestined") | known.words("directions") | known.words("look")
            if phrase == "into" and _names_motion(rest):
                continue
            thing = bool(known.words("room_things") & set(rest)) or (
                phrase in known.words("toward") and words[0] in known.words("walk_verbs") and _is_seen_nowhere(rest)
            )
            if thing or (rest and not any(word in own for word in rest)):
                return [" ".join(words[place:])]
    return []


def _is_seen_nowhere(words: list[str]) -> bool:
    """Whether words name a person, or a part of a room ("other side of the room"): the robot sees neither."""
    known = vocabulary()
    return bool(known.words("persons") & set(words)) or begins(list(words), 0, known.phrases("room_parts")) is not None


def _names_motion(words: list[str]) -> bool:
    """Whether words name a kind of motion: "a squat", "deep bow for me", "squatting position"."""
    name = list(takewhile(lambda word: word not in ("for", "to"), words))
    if name[-1:] and name[-1] in ("position", "posture", "pose"):
        name = name[:-1]
    return bool(name) and (name[-1] in taught() or stem(name[-1]) in taught())
