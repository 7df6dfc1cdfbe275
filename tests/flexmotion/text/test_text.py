"""Word pieces, wordings and mirror images of text."""

from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from flexmotion.text.manners import styled
from flexmotion.text.phrases import STAND, kinds, velocity, wordings
from flexmotion.text.sides import mirrored
from flexmotion.text.word_pieces import LONGEST, WordPieces

PIECES = ["[UNK]", "wave", "walk", "##ing", "##s", "hand", "a"]


@pytest.mark.parametrize(
    ("sentence", "expected"),
    [
        ("Waving hands!", [0, 5, 4]),
        ("wave, WALKING", [1, 2, 3]),
        ("", []),
        ("… !?", []),
        ("wavé", [1]),
    ],
)
def test_word_pieces(sentence: str, expected: list[int]) -> None:
    assert WordPieces(PIECES)(sentence) == expected


@settings(max_examples=200)
@given(st.text(max_size=400))
def test_any_text_can_be_read(sentence: str) -> None:
    found = WordPieces(PIECES)(sentence)
    assert len(found) <= LONGEST
    assert all(0 <= piece < len(PIECES) for piece in found)


def test_every_kind_has_wordings() -> None:
    assert STAND in kinds()
    for kind in kinds():
        said = wordings(kind)
        assert len(said) >= 20 and len(set(said)) == len(said)
        assert all(isinstance(text, str) and text == text.strip() and text for text in said)
    assert wordings("byebye") == wordings("bye")
    assert wordings("no such motion") == ()


def test_styles() -> None:
    assert "walk forward energetically" in styled("walk forward", "energetic")
    assert styled("walk forward", "normal") == ("walk forward",)
    assert styled("walk forward", "no such style") == ("walk forward",)


@pytest.mark.parametrize(
    ("text", "other"),
    [
        ("turn left", "turn right"),
        ("walk-turn-right", "walk-turn-left"),
        ("Left hand, then right", "Right hand, then left"),
        ("turn clockwise", "turn counterclockwise"),
        ("stand upright in bright light", "stand upright in bright light"),
        ("step leftwards", "step rightwards"),
    ],
)
def test_mirrored(text: str, other: str) -> None:
    assert mirrored(text) == other
    assert mirrored(other) == text


@pytest.mark.parametrize("word", ["counter-clockwise", "Anticlockwise", "anti clockwise", "counter clockwise"])
def test_all_spellings_of_counterclockwise_have_one_mirror_image(word: str) -> None:
    """Regression: that of "anticlockwise" was "anticounterclockwise", taught as a turn to the right."""
    assert mirrored(word).lower() == "clockwise"


def test_mirrored_words_mean_the_mirrored_velocity() -> None:
    for kind in kinds():
        meant, other = velocity(kind), velocity(mirrored(kind))
        assert (meant is None) == (other is None)
        if meant is not None and other is not None:
            assert other == (meant[0], -meant[1], -meant[2])
    assert velocity("walk-left") is not None and velocity("no such motion") is None
