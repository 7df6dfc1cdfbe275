"""Phrases of what is done beside a motion."""

from __future__ import annotations

import pytest

from flexmotion.text.grammar import parse
from flexmotion.text.meanwhile import meanwhile


@pytest.mark.parametrize(
    ("phrase", "asks"),
    [
        ("while waving", "wave"),
        ("while you wave with both hands", "wave with both hands"),
        ("while you're waving", "wave"),
        ("as you are walking", "walk"),
        ("waving your left hand", "wave your left hand"),
        ("with your hands on your hips", "your hands on your hips"),
        ("while i walk", None),  # walked
        ("while she waves at you", None),
        ("while the music plays", None),
        ("while not waving", None),
        ("at the same time", None),
        ("slowly", None),
    ],
)
def test_what_the_robot_is_asked_to_do_meanwhile(phrase: str, asks: str | None) -> None:
    assert meanwhile(phrase) == asks


@pytest.mark.parametrize(
    ("sentence", "requests"),
    [
        ("walk pointing to the left", [("walk", ("pointing to the left",))]),
        ("walk waving for three steps", [("walk forward", ("waving",))]),
        ("walk with your arms out to the sides", [("walk", ("with your arms out to the sides",))]),
        ("walk, and at the same time nod", [("walk", ()), ("nod", ("at the same time",))]),
        ("stop walking and waving", [("stop", ("walking and waving",))]),
    ],
)
def test_a_phrase_ends_where_the_motion_goes_on(sentence: str, requests: list[tuple[str, tuple[str, ...]]]) -> None:
    """Words behind a gesture turned the walk, "to the sides" was lost, "and at the same time nod" was one motion."""
    assert [(clause.text, clause.dropped) for clause in parse(sentence)] == requests
