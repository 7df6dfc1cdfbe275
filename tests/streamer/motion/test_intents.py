"""Intents, the words for them, and which are refused."""

from __future__ import annotations

import math
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from flexmotion.configs.errors import ConfigError
from flexmotion.streamer.motion.intents import (
    FASTEST,
    WORDS,
    Clip,
    Heading,
    Intent,
    Stop,
    Text,
    Velocity,
    Waypoint,
    from_content,
    to_content,
    word_of,
)

_WORDS = st.text(st.characters(exclude_characters="\0", exclude_categories=["Cs"]), min_size=1).filter(str.strip)
_LINES = st.text(st.characters(exclude_categories=["C", "Z"], include_characters=" "), min_size=1, max_size=100).filter(
    str.strip
)
_INTENTS = st.one_of(
    st.builds(Clip, _WORDS),
    st.builds(Text, _LINES),
    st.builds(Velocity, *(st.floats(-limit, limit) for limit in FASTEST)),
    st.builds(Heading, st.floats(-1e3, 1e3), st.none() | st.floats(0.05, 3.0)),
    st.builds(Waypoint, *[st.floats(-1e3, 1e3)] * 2, st.none() | st.floats(-1e3, 1e3), st.floats(0.03, 1.0)),
    st.just(Stop()),
)


@given(_INTENTS)
def test_an_intent_comes_back_from_its_words(intent: Intent) -> None:
    assert from_content({"at": 3, **to_content(intent)}) == intent
    assert isinstance(intent, WORDS[word_of(intent)])


def test_two_at_once_are_refused() -> None:
    with pytest.raises(ConfigError, match="exactly one of: clip, .*, waypoint, stop; found text and stop"):
        from_content({"text": "wave", "stop": True})


@pytest.mark.parametrize(
    "value", [(math.nan, 99, 0), (0, math.inf, 0), (3.1, 0, 0), (0, 0, -3.1), (True, 0, 0), ("1", 0, 0)]
)
def test_an_invalid_velocity_is_refused_from_anywhere(value: tuple[Any, Any, Any]) -> None:
    """Only scripts were checked: a program sent NaN to the planner."""
    with pytest.raises(ConfigError, match=r"velocity: expected \[forward m/s, left m/s, turning rad/s\].*, found"):
        Velocity(*value)
    with pytest.raises(ConfigError, match=r"velocity: expected .*, found \["):
        from_content({"velocity": list(value)})


@pytest.mark.parametrize("value", ["", " \n", "wave\0", None, 3])
def test_empty_words_are_refused_from_anywhere(value: Any) -> None:
    """A target without words reached the model."""
    for kind, message in (
        (Clip, "clip: expected a file or a name"),
        (Text, "text: expected words that say what to do"),
    ):
        with pytest.raises(ConfigError, match=message):
            kind(value)
        with pytest.raises(ConfigError, match=message):
            from_content({message[:4]: value})


@pytest.mark.parametrize("text", ["walk\nforward", "walk \x1b[31m", "walk \udcff", "x" * 241])
def test_words_are_one_printable_line(text: str) -> None:
    """The robot followed bytes that were no text, and the report could not be written at the end."""
    with pytest.raises(ConfigError, match="text: expected a line of 240 characters at most"):
        Text(text)
