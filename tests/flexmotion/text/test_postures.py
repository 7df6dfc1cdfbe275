"""What a request says of a part of the body beside its motion."""

from __future__ import annotations

import pytest

from flexmotion.text.amounts import tokens_of
from flexmotion.text.postures import moves_along, without_posture
from flexmotion.text.wording import plain


@pytest.mark.parametrize(
    ("sentence", "rest", "posture"),
    [
        ("walk with your eyes closed", "walk", "with your eyes closed"),
        ("walk forward keeping both arms still", "walk forward", "keeping both arms still"),
        ("turn left with your arms up for two seconds", "turn left for two seconds", "with your arms up"),
        ("walk with your left foot first", "walk", "with your left foot first"),
        ("walk with me", "walk with me", None),
        ("walk with your hands", "walk with your hands", None),
        ("wave with your left hand raised", "wave with your left hand raised", None),
    ],
)
def test_a_walk_is_told_from_the_posture_that_it_is_to_be_made_in(
    sentence: str, rest: str, posture: str | None
) -> None:
    """A walk "with your eyes closed" was done with no word about the eyes."""
    tokens, found = without_posture(tokens_of(sentence))
    assert (plain(tokens), found) == (rest, posture)


@pytest.mark.parametrize(
    ("sentence", "rest"),
    [
        ("step with your right foot to the right", "step with your right foot to the right"),
        ("walk with your feet to the left", "walk with your feet to the left"),
        ("walk with your hands forward", "walk with your hands forward"),
        ("walk with your arms limp to the left", "walk with your arms limp to the left"),
        ("step with your left foot backwards", "step backwards"),
        ("walk with your left arm raised to the right", "walk to the right"),
        ("walk with your arms up left", "walk left"),
        ("walk with your hands behind your back", "walk"),
        ("walk with your right foot in front of the left", "walk"),
        ("walk with your eyes closed slowly", "walk slowly"),
        ("walk with your head down but a short distance", "walk but a short distance"),
    ],
)
def test_a_posture_takes_nothing_that_is_said_of_the_walk(sentence: str, rest: str) -> None:
    """A step "with your right foot to the right" was a walk ahead without end; "but not far" was lost likewise."""
    assert plain(without_posture(tokens_of(sentence))[0]) == rest


@pytest.mark.parametrize(
    ("text", "along"),
    [
        ("swing your arms", True),
        ("moving the head", True),
        ("lift your feet", True),
        ("raise your arm", False),
        ("wave your hand", False),
        ("swing", False),
        ("arms", True),
        ("your left hand", True),
        ("with the left hand", False),
    ],
)
def test_what_a_motion_does_by_itself_is_told_from_motions_of_their_own(text: str, along: bool) -> None:
    """Arms that were not to swing swung: only forbidden motions that are requests of their own were looked for."""
    assert moves_along(text) == along
