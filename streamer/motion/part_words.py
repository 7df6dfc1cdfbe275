"""`part_of_words`: the intent for head or arm of a sentence that asks for nothing else."""

from __future__ import annotations

from flexmotion.streamer.motion.intents import Intent, Text
from flexmotion.streamer.motion.part_intents import Look, PartIntent, Point
from flexmotion.text.part_phrases import part_phrase

WORDS_HOLD_S = 5.0
"""A look or a point that was asked for in words is held this long; words say no end [s]."""
_IN_S = 0.8
_TOLERANCE = 0.8
"""Words name a direction to within this angle [rad]."""


def part_of_words(intent: Intent) -> PartIntent | None:
    """What the words of an intent ask of head or arm alone; None where they ask for anything else."""
    found = part_phrase(intent.text) if isinstance(intent, Text) else None
    if found is None:
        return None
    if found.side is None:
        return Look(found.direction, _IN_S, _TOLERANCE)
    return Point(found.side, found.direction, _IN_S, _TOLERANCE)
