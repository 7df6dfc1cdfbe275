"""Misspelt words are replaced by known ones, to be suggested."""

from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from flexmotion.text.spelling import respelled, unknown_words


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
