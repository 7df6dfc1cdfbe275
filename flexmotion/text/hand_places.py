"""`hand_place`: why a hand is not put where a request says: "put your left hand on your hip"."""

from __future__ import annotations

import re
from functools import lru_cache

from flexmotion.text.vocabulary import vocabulary
from flexmotion.text.wording import stem, taught

_HIPS = frozenset(["hip", "hips", "waist", "belt"])


def hand_place(words: list[str]) -> str | None:
    """Why no motion puts a hand, or both, where words say; None where one may, or they put none anywhere.

    A listener hears a raised hand in them. Both hands are put on the hips, one on the heart.
    """
    text = " ".join([stem(word) if place == 0 else word for place, word in enumerate(words)])
    found = _pattern().match(text)
    if found is None or " ".join(words) in taught():
        return None
    one = not found["hands"].endswith("s") and "both" not in found["whose"].split()
    where, told = found["place"], found["to"]
    if where in _HIPS:
        return f"{told!r}: a motion of both hands; say 'put your hands on your hips'" if one else None
    if found["prep"] in ("over", "to") and where == "head":
        return None  # a raised hand
    return f"{told!r}: no words put a hand there; one is placed by a target: flexmotion send --hand --help"


@lru_cache
def _pattern() -> re.Pattern[str]:
    known = vocabulary()
    verbs, places, arms = ("|".join(known.table[name]) for name in ("putting", "hand_places", "limbs"))
    owners = "|".join(known.table["limb_owners"])
    hands = f"{arms}|palm|palms|fist|fists|finger|fingers"
    return re.compile(
        rf"(?:(?:{verbs}) )?(?P<whose>(?:(?:{owners}|of) )*)(?P<hands>{hands}) "
        rf"(?:[a-z]+ly |flat |up |down |back |folded |crossed )*"
        rf"(?P<to>(?P<prep>on|onto|in|into|inside|behind|under|against|to|at|near|around|across|between|over) "
        rf"(?:(?:{owners}|my|own) )*(?P<place>{places}))\b(?! height| level)"
    )
