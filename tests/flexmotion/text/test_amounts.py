"""Amounts of sentences are looked for only where one can begin."""

from __future__ import annotations

import pytest

from flexmotion.text import amounts
from flexmotion.text.amounts import tokens_of
from flexmotion.text.sayings import sayings

SENTENCES = (
    *[sentence for _, sentence in sayings()][::20],
    "walk as fast as you can",
    "walk at a slow pace, then at half the speed",
    "slow down by half",
    "two slow steps and one to the left",
    "turn minus 90 degrees and raise the arm ½",
    "step ahead 1,5 m or take a dozen steps",
    "wave two or three times",
)


def test_the_short_way_finds_what_the_long_way_finds(monkeypatch: pytest.MonkeyPatch) -> None:
    """The long way looks at every word; with 7000 taught sentences it was most of a program's start."""
    short = [tokens_of(sentence) for sentence in SENTENCES]
    monkeypatch.setattr(amounts, "_counts", lambda word: True)
    assert short == [tokens_of(sentence) for sentence in SENTENCES]
    assert sum(not isinstance(token, str) for found in short for token in found) > 10
