"""What a request says of a part of the body beside its motion: "walk with your eyes closed"."""

from __future__ import annotations

from functools import lru_cache

from flexmotion.text.amounts import Amount, Token
from flexmotion.text.sides import sides
from flexmotion.text.vocabulary import vocabulary
from flexmotion.text.wording import STAND_IN, begins, plain, stem

_SHORTEST_HELD = 4
"""Letters that a word in "-ed" or "-ing" has more than, if it tells how a part of the body is held."""


def without_posture(tokens: list[Token]) -> tuple[list[Token], str | None]:
    """A walk or a turn without the posture that it is to be made in, and that posture; None where it says none.

    The model walks as it does: how the eyes or the arms are held meanwhile is not done. Words that may tell where the
    walk goes are no posture: "step with your right foot to the right".
    """
    known = vocabulary()
    stepped = any(isinstance(token, Amount) and token.quantity == "steps" for token in tokens)
    takes = stepped and (tokens[0] in ("take", "make", "do") or isinstance(tokens[0], Amount))
    waves = tokens[:1] == ["wave"]
    own = known.words("paths") | known.words("postured") | known.words("backing")
    if not tokens or not (takes or waves or (isinstance(tokens[0], str) and stem(tokens[0]) in own)):
        return tokens, None
    legs = known.table["limb_groups"]["leg"] if tokens[0] == "step" or stepped else []
    for place in range(1, len(tokens)):
        if tokens[place] not in known.words("posture_opens"):
            continue
        part, held = place + 1, False
        while part < len(tokens) and (tokens[part] in known.words("limb_owners") or _is_held(tokens[part])):
            part, held = part + 1, held or _is_held(tokens[part])
        if part == len(tokens) or tokens[part] not in body_parts():
            continue
        if waves and tokens[part + 1 : part + 2] not in (["on"], ["behind"]):
            continue  # "wave with your hand up high" says how it waves
        end = part + 1 if tokens[part] in legs else _end(tokens, part + 1)
        manner = any(isinstance(token, str) and token.startswith(STAND_IN) for token in tokens[:place])
        if held and manner:
            continue  # "walk like someone with an injured knee"
        if held and end == part + 1:
            return [*tokens[:place], *tokens[end:]], plain(tokens[place:end])  # "with raised hands"
        if part == place + 1 and tokens[part] not in legs and not _poses(_word(tokens, part + 1)):
            continue
        rest = [*tokens[:place], *tokens[end:]]
        straight = known.words("onward") | known.words(
            "backward"
        )  # whichever foot steps: "step back with your left foot"
        ahead = straight & {*rest} or not [token for token in rest[1:] if isinstance(token, str)]
        if end > part + 1 or (tokens[part] in legs and ahead and not sides(plain(rest))):
            return rest, plain(tokens[place:end])
    return tokens, None


def _is_held(token: Token) -> bool:
    """Whether a word in front of a part of the body tells how it is held: "raised hands"."""
    return isinstance(token, str) and token.endswith(("ed", "ing")) and len(token) > _SHORTEST_HELD


def _word(tokens: list[Token], place: int) -> str:
    """The word at a place; empty where there is none."""
    token = tokens[place] if place < len(tokens) else ""
    return token if isinstance(token, str) else ""


def _end(tokens: list[Token], start: int) -> int:
    """The end of a posture whose first word behind the part of the body is at `start`; `start`: there is none.

    A direction behind a word of a posture ends it ("with your arms up to the left"), any other may be the walk's.
    """
    known = vocabulary()
    posed, whole = False, start
    for place in range(start, len(tokens)):
        if place < whole:
            continue
        token = tokens[place]
        if phrase := begins(tokens, place, known.phrases("posture_places")):
            posed, whole = True, place + len(phrase.split())
            continue
        if not isinstance(token, str) or token.startswith(STAND_IN):
            return place
        turned = tokens[place - 1] in known.words("turned")
        named = posed and (turned or tokens[place - 1] in known.words("limb_owners"))  # "behind your back"
        if _poses(token) or (turned and token in ("to", "towards")):
            posed = True  # "turned to the left"
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
