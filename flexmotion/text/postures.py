"""What a request says of a part of the body beside its motion: "walk with your eyes closed"."""

from __future__ import annotations

from functools import lru_cache

from flexmotion.text.amounts import Token
from flexmotion.text.sides import sides
from flexmotion.text.vocabulary import vocabulary
from flexmotion.text.wording import begins, plain, stem


def without_posture(tokens: list[Token]) -> tuple[list[Token], str | None]:
    """A walk or a turn without the posture that it is to be made in, and that posture; None where it says none.

    The model walks as it does: how the eyes or the arms are held meanwhile is not done. Words that may tell where the
    walk goes are no posture: "step with your right foot to the right".
    """
    known = vocabulary()
    if not tokens or tokens[0] not in known.words("paths"):
        return tokens, None
    legs = known.table["limb_groups"]["leg"] if tokens[0] == "step" else []
    for place in range(1, len(tokens)):
        if tokens[place] not in known.words("posture_opens"):
            continue
        part = place + 1
        while part < len(tokens) and tokens[part] in known.words("limb_owners"):
            part += 1
        if part in (place + 1, len(tokens)) or tokens[part] not in body_parts():
            continue
        end = part + 1 if tokens[part] in legs else _end(tokens, part + 1)
        rest = [*tokens[:place], *tokens[end:]]
        straight = known.words("onward") | known.words(
            "backward"
        )  # whichever foot steps: "step back with your left foot"
        if end > part + 1 or (tokens[part] in legs and straight & {*rest} and not sides(plain(rest))):
            return rest, plain(tokens[place:end])
    return tokens, None


def _end(tokens: list[Token], start: int) -> int:
    """The end of a posture whose first word behind the part of the body is at `start`; `start`: there is none.

    A direction behind a word of a posture ends it ("with your arms up to the left"), any other may be the walk's.
    """
    known = vocabulary()
    posed = False
    for place in range(start, len(tokens)):
        token = tokens[place]
        if not isinstance(token, str):
            return place
        named = posed and tokens[place - 1] in known.words("limb_owners")  # "behind your back"
        if _poses(token):
            posed = True
        elif token in known.words("directions") and not named:
            return place if posed else start
        elif posed and (token in known.table["speeds"] or begins(tokens, place, known.phrases("little"))):
            return place
        elif token in known.words("posture_ends") and place > start:
            later = set(tokens[place:]) & known.words("directions")
            return start if later and not posed else place
    return len(tokens)


def _poses(word: str) -> bool:
    """Whether a word tells how a part of the body is held: "up", "closed", "hanging"."""
    return word in vocabulary().words("limb_postures") or word.endswith(("ing", "ed"))


def moves_along(text: str) -> bool:
    """Whether words name what a motion does by itself with a part of the body: "swing your arms", "lift your feet"."""
    known, words = vocabulary(), text.split()
    if words and set(words) & body_parts() and set(words) <= body_parts() | known.words("limb_owners"):
        return True  # "with no arms"
    if not words or not set(words[1:]) & body_parts():
        return False
    legs = set(known.table["limb_groups"]["leg"]) & set(words[1:])
    verb = stem(words[0])
    return verb in known.words("moved_along") or (verb in known.words("lifted_along") and bool(legs))


@lru_cache
def body_parts() -> frozenset[str]:
    """Names of the limbs and of other parts of the body."""
    known = vocabulary()
    limbs = (name for names in known.table["limb_groups"].values() for name in names)
    return frozenset(limbs) | known.words("body") | known.words("head")
