"""Sentences for head and arms alone, and those that say more."""

from __future__ import annotations

import pytest

from flexmotion.text.part_phrases import PartPhrase, part_phrase
from flexmotion.text.phrases import kinds, wordings


@pytest.mark.parametrize(
    ("sentence", "sign", "axis"),
    [
        ("look left", 1, 1),
        ("Look to the right, please!", -1, 1),
        ("look up", 1, 2),
        ("look down at the floor", None, 0),
        ("glance at the ceiling", 1, 2),
        ("look at the floor", -1, 2),
        ("turn your head to the left", 1, 1),
        ("look to your left side", 1, 1),
    ],
)
def test_a_look_is_heard_with_its_direction(sentence: str, sign: int | None, axis: int) -> None:
    found = part_phrase(sentence)
    if sign is None:
        assert found is None  # two ways at once are left to the grammar
        return
    assert found is not None and (found.act, found.side) == ("look", None)
    assert sign * found.direction[axis] > 0.3 and found.direction[0] == 1.0


@pytest.mark.parametrize(
    ("sentence", "expected"),
    [
        ("point to the right", PartPhrase("point", (0.0, -1.0, 0.0), "right", "point-right")),
        ("point left", PartPhrase("point", (0.0, 1.0, 0.0), "left", "point-left")),
        ("point up with your left hand", PartPhrase("point", (0.0, 0.0, 1.0), "left", "point-up-left-hand")),
        ("point straight ahead", PartPhrase("point", (1.0, 0.0, 0.0), "right", "point-forward-right-hand")),
        ("reach up with the left hand", PartPhrase("point", (0.0, 0.0, 1.0), "left", "raise-up-left-hand")),
        (
            "stretch your right arm out to the front",
            PartPhrase("point", (1.0, 0.0, 0.0), "right", "hold-out-right-hand"),
        ),
        ("reach to the right with the right hand", PartPhrase("point", (0.0, -1.0, 0.0), "right", "point-right")),
        ("point to the right with the left hand", PartPhrase("point", (0.0, -1.0, 0.0), "left")),
        ("point down", PartPhrase("point", (0.0, 0.0, -1.0), "right")),
        ("look ahead", PartPhrase("look", (1.0, 0.0, 0.0))),
    ],
)
def test_a_point_and_a_reach_are_heard_with_arm_and_direction(sentence: str, expected: PartPhrase) -> None:
    assert part_phrase(sentence) == expected


def test_a_wording_of_a_kind_means_that_kind() -> None:
    """Which kind a look or a point is was not known, so a robot that was judged not to do it did it all the same."""
    found = [(kind, part) for kind in kinds() for words in wordings(kind) if (part := part_phrase(words))]
    assert found and {part.kind for _, part in found} >= {"look-down", "point-left", "raise-up-left-hand"}
    assert all(part.kind == kind for kind, part in found)


@pytest.mark.parametrize(
    "sentence",
    [
        "look to the left and go there",
        "walk forward and look left",
        "do not look left",
        "look left, then right",
        "turn left",
        "reach up",
        "look around",
        "look behind you",
        "point at me",
        "face left",
        "walk to the left",
        "wave with the right hand",
        "",
    ],
)
def test_a_sentence_that_says_more_or_anything_else_is_left_to_the_grammar(sentence: str) -> None:
    assert part_phrase(sentence) is None
