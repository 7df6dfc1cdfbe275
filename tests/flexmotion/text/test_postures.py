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
    ("text", "along"),
    [
        ("swing your arms", True),
        ("moving the head", True),
        ("lift your feet", True),
        ("raise your arm", False),
        ("wave your hand", False),
        ("swing", False),
    ],
)
def test_what_a_motion_does_by_itself_is_told_from_motions_of_their_own(text: str, along: bool) -> None:
    """Arms that were not to swing swung: only forbidden motions that are requests of their own were looked for."""
    assert moves_along(text) == along
