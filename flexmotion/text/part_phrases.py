"""`part_phrase`: sentences that ask for nothing but a look, a point or a reach: "look left", "point to the right".

They are goals for head and arms, which need no motion of the human. A sentence that says anything else beside, "look to
the left and go there", is left to the grammar.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Literal

Direction = tuple[float, float, float]
Act = Literal["look", "point"]

_WAYS: dict[str, Direction] = {
    "left": (0.0, 1.0, 0.0),
    "right": (0.0, -1.0, 0.0),
    "up": (0.0, 0.0, 1.0),
    "down": (0.0, 0.0, -1.0),
    "ahead": (1.0, 0.0, 0.0),
}
_LOOKS: dict[str, Direction] = {
    "left": (1.0, 1.2, 0.0),
    "right": (1.0, -1.2, 0.0),
    "up": (1.0, 0.0, 0.6),
    "down": (1.0, 0.0, -0.6),
    "ahead": (1.0, 0.0, 0.0),
}
"""A head turns by 50° to a side and by 31° up and down: what humans do for the words, and most robots can."""
_POINTS = {"up": "point-up", "ahead": "point-forward"}
_REACHES = {"up": "raise-up", "ahead": "hold-out"}
"""Kinds of motion by way, without the hand. To the side of its own an arm that reaches is one that points there."""
_SAME = {"upward": "up", "upwards": "up", "downward": "down", "downwards": "down", "leftward": "left"}
_SAME |= dict.fromkeys(("forward", "forwards", "straight", "front", "out"), "ahead")
_SAME |= {"rightward": "right", "leftwards": "left", "rightwards": "right", "ceiling": "up", "sky": "up"}
_SAME |= {"floor": "down", "ground": "down"}

_WAY = rf"(?P<way>{'|'.join([*_WAYS, *_SAME])})"
_TO = r"(?:(?:straight|over|out)\s)?(?:(?:to|towards?|at)\s)?(?:(?:the|your|its)\s)?"
_ARM = r"(?:\swith\s(?:the|your|its|a)\s(?P<side>left|right)\s(?:hand|arm|finger))"
_HAND_FIRST = r"(?:(?:the|your|its)\s(?P<first>left|right)\s(?:hand|arm)\s)?"
_SIDE_WORD = r"(?:\s(?:side|hand\sside))?"
_LOOK = re.compile(rf"(?:(?:look|gaze|glance)\s|turn\s(?:your|the)\shead\s){_TO}{_WAY}{_SIDE_WORD}")
_POINT = re.compile(rf"point\s{_HAND_FIRST}{_TO}{_WAY}{_SIDE_WORD}{_ARM}?")
_REACH = re.compile(rf"(?:reach|stretch)\s{_HAND_FIRST}{_TO}{_WAY}{_ARM}?")
POLITE = re.compile(r"\b(?:please|now|robot|hey|can you|could you)\b")
"""What is said to be polite, or to be listened to; it changes nothing."""


@dataclass(frozen=True)
class PartPhrase:
    """What a sentence asks of head or arm.

    Attributes:
        act: a reach is a point: an almost straight arm.
        direction: seen from the trunk: ahead, left, up.
        side: of the arm, left or right; None: of the head.
        kind: of motion that the words mean, which a robot was judged to do or not; None: they mean none of those, as a
            look ahead, a point down, and a point to the other side than that of the arm.
    """

    act: Act
    direction: Direction
    side: Literal["left", "right"] | None = None
    kind: str | None = None


def part_phrase(sentence: str) -> PartPhrase | None:
    """What a whole sentence asks of head or arm alone; None where it asks for anything else.

    An arm that is not named is that of the side where it points, else the right one. A reach needs a named arm.
    """
    words = " ".join(POLITE.sub(" ", " ".join(re.findall(r"[a-z]+", sentence.lower()))).split())
    found = _LOOK.fullmatch(words)
    if found is not None:
        way = _way(found)
        return PartPhrase("look", _LOOKS[way], kind=None if way == "ahead" else f"look-{way}")
    found = _POINT.fullmatch(words) or _REACH.fullmatch(words)
    if found is None:
        return None
    way, named = _way(found), found["side"] or found["first"]
    if named is None and found.re is _REACH:
        return None
    side: Literal["left", "right"] = "left" if (named or way) == "left" else "right"
    kinds = _REACHES if found.re is _REACH else _POINTS
    kind = f"{kinds[way]}-{side}-hand" if way in kinds else f"point-{way}" if way == side else None
    return PartPhrase("point", _WAYS[way], side, kind)


def _way(found: re.Match[str]) -> str:
    return _SAME.get(found["way"], found["way"])
