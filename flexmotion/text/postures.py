"""What a request says of a part of the body beside its motion: "walk with your eyes closed"."""

from __future__ import annotations

from functools import lru_cache

from flexmotion.text.amounts import Token
from flexmotion.text.vocabulary import vocabulary
from flexmotion.text.wording import plain, stem

_OPENS = ("with", "keeping", "holding", "keep", "hold")
_ENDS = frozenset(["for", "to", "towards", "until", "and", "forward", "forwards", "backwards", "please", "again"])


def without_posture(tokens: list[Token]) -> tuple[list[Token], str | None]:
    """A walk or a turn without the posture that it is to be made in, and that posture; None where it says none.

    The model walks as it does: how the eyes or the arms are held meanwhile is not done.
    """
    known = vocabulary()
    if not tokens or tokens[0] not in known.words("paths"):
        return tokens, None
    for place in range(1, len(tokens)):
        if tokens[place] not in _OPENS:
            continue
        part = place + 1
        while part < len(tokens) and tokens[part] in known.words("limb_owners"):
            part += 1
        if part in (place + 1, len(tokens)) or tokens[part] not in body_parts():
            continue
        end = part + 1
        while end < len(tokens) and isinstance(tokens[end], str) and (end == part + 1 or tokens[end] not in _ENDS):
            end += 1
        if end > part + 1:
            return [*tokens[:place], *tokens[end:]], plain(tokens[place:end])
    return tokens, None


def moves_along(text: str) -> bool:
    """Whether words name what a motion does by itself with a part of the body: "swing your arms", "lift your feet"."""
    known, words = vocabulary(), text.split()
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
