"""Left and right in sentences."""

from __future__ import annotations

import re

LEFT, RIGHT = "left", "right"

_COUNTERCLOCKWISE = r"(?:counter|anti)[\s\W]*clockwise"

_NO_SIDE = re.compile(
    r"""\bright\ (?:now|away)\b
    | \b(?:all|is|are|was|were|quite|yes|that['’]?s|you['’]?re|he['’]?s|she['’]?s)\ right\b
    | ^\W*(?:(?:ok|okay|yes|well)\W+)?right\b(?=\W+(?:then|so)\b|\s*[,.;:!]\s*\w)
    | ,\s*right\s*\?+\s*$
    | \b(?:i|he|she|we|they|you|who|is|are|was|were|have|has|had|minutes?|seconds?|time|much|nothing|what['’]s)\ left\b
      (?!\ (?:hand|arm|side|foot|leg))""",
    re.IGNORECASE | re.VERBOSE,
)
""""left" and "right" with another meaning than a side: "right now", "that's right", "I left"."""

_SWAPS = {"left": "right", "right": "left", "clockwise": "counterclockwise"}


def mirrored(text: str) -> str:
    """The text with left and right, clockwise and counterclockwise swapped, also within words."""

    def swap(match: re.Match[str]) -> str:
        word = match[0]
        other = _SWAPS.get(word.lower(), "clockwise")
        return other.capitalize() if word[0].isupper() else other

    return re.sub(rf"(?i){_COUNTERCLOCKWISE}|clockwise|left|(?<!up)(?<!b)right", swap, text)


def sides(text: str) -> frozenset[str]:
    """Sides (`LEFT`, `RIGHT`) that a sentence or a kind of motion names."""
    rest, turned = re.subn(rf"(?i){_COUNTERCLOCKWISE}", " ", _NO_SIDE.sub(" ", text))
    left = turned > 0 or re.search(r"(?i)\bleft", rest) is not None
    right = re.search(r"(?i)\bright|\bclockwise", rest) is not None
    return frozenset(side for side, named in ((LEFT, left), (RIGHT, right)) if named)


def is_other_side(kind: str, sentence: str) -> bool:
    """Whether a sentence names one side only and a kind of motion is to the other."""
    named, meant = sides(sentence), sides(kind)
    return len(named) == 1 and len(meant) == 1 and named != meant
