"""Misspelt words are replaced by known ones, to be suggested."""

from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from flexmotion.text.spelling import as_meant, respelled, unknown_words


@pytest.mark.parametrize("sentence", ["0aiQr", "2wlak", "walk2 _wlak"])
def test_a_word_beside_a_digit_is_respelled_as_any_other(sentence: str) -> None:
    """The word of "0aiQr" stayed as it was, so that reading the suggestion suggested it again, without end."""
    meant = respelled(sentence)
    assert meant is not None and not unknown_words(meant)


@given(st.text(alphabet="walkturn_09 ", max_size=20))
@settings(deadline=None)
def test_what_is_suggested_has_no_unknown_words(sentence: str) -> None:
    meant = respelled(sentence)
    assert meant is None or not unknown_words(meant)


@pytest.mark.parametrize(
    ("typed", "meant"),
    [
        ("Turn Letf, please", "Turn left, please"),  # two swapped
        ("turn lefft", "turn left"),  # one too many
        ("walk foward", "walk forward"),  # one missing
        ("walk bavkwards", "walk backwards"),  # one wrong
        ("turn hleft", "turn hleft"),  # the first letter is another
        ("turn lfte", "turn lfte"),  # two wrong
        ("turn loft", "turn loft"),  # a word
        ("lt", "lt"),  # too short
    ],
)
def test_a_direction_is_read_through_one_wrong_letter(typed: str, meant: str) -> None:
    found, notes = as_meant(typed, lambda word: word == "loft")
    assert found == meant and bool(notes) == (found != typed)


@given(st.text(max_size=40))
@settings(deadline=None)
def test_no_text_is_changed_whose_words_are_known(text: str) -> None:
    assert as_meant(text, lambda word: True) == (text, ())


@pytest.mark.parametrize(("typed", "meant"), [("bow twise", "twice"), ("wave thrise", "thrice"), ("bow twce", "twice")])
def test_a_count_is_read_through_one_wrong_letter(typed: str, meant: str) -> None:
    """The words "bow twise" bowed once, and no word was said of it."""
    verb, word = typed.split()
    assert as_meant(typed, lambda word: False) == (f"{verb} {meant}", (f"{word!r} is read as {meant!r}",))
