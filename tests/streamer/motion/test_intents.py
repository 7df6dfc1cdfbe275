"""Intents, the words for them, and which are refused."""

from __future__ import annotations

import math
from collections.abc import Callable
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
from flexmotion.streamer.motion.part_intents import FootPlace, Hand, JointAngle, Look, Point, Relax
from flexmotion.streamer.motion.restriction_intents import Contact, Tension, TorqueCap
from flexmotion.streamer.motion.targets import TargetMailbox

_WORDS = st.text(st.characters(exclude_characters="\0", exclude_categories=["Cs"]), min_size=1).filter(str.strip)
_LINES = st.text(st.characters(exclude_categories=["C", "Z"], include_characters=" "), min_size=1, max_size=100).filter(
    str.strip
)
_SIDES = st.sampled_from(["left", "right"])
_PLACES = st.tuples(*[st.floats(-2.0, 2.0)] * 3)
_DIRECTIONS = _PLACES.filter(lambda direction: max(map(abs, direction)) > 0.01)
_INTENTS = st.one_of(
    st.builds(Clip, _WORDS),
    st.builds(Text, _LINES),
    st.builds(Velocity, *(st.floats(-limit, limit) for limit in FASTEST)),
    st.builds(Heading, st.floats(-6.0, 6.0), st.none() | st.floats(0.05, 3.0)),
    st.builds(Waypoint, *[st.floats(-1e3, 1e3)] * 2, st.none() | st.floats(-6.0, 6.0), st.floats(0.03, 1.0)),
    st.just(Stop()),
    st.builds(Hand, _SIDES, _PLACES, st.floats(0.0, 10.0), st.floats(0.0, 2.0)),
    st.builds(FootPlace, _SIDES, st.tuples(*[st.floats(-1.0, 1.0)] * 2), st.floats(-3.0, 3.0), st.floats(0.0, 10.0)),
    st.builds(Point, _SIDES, _DIRECTIONS, st.floats(0.0, 10.0)),
    st.builds(Look, _DIRECTIONS, st.floats(0.0, 10.0)),
    st.builds(JointAngle, st.sampled_from(["l_el", "head_pan"]), st.floats(-6.0, 6.0), st.floats(0.0, 10.0)),
    st.builds(Relax, st.sampled_from(["all", "head", "left hand"])),
    st.builds(Contact, st.sampled_from(["left", "right", "both"])),
    st.builds(TorqueCap, st.sampled_from(["knee", "left knee", "l_el"]), st.floats(0.01, 1000.0)),
    st.builds(Tension, st.sampled_from(["left arm", "right arm", "both arms", "head"]), st.floats(0.0, 1.0)),
)


@given(_INTENTS)
def test_an_intent_comes_back_from_its_words(intent: Intent) -> None:
    assert from_content({"at": 3, **to_content(intent)}) == intent
    assert isinstance(intent, WORDS[word_of(intent)])


@given(_INTENTS)
def test_an_intent_comes_back_from_shared_memory_bit_by_bit(intent: Intent) -> None:
    mailbox = TargetMailbox()
    try:
        sent = mailbox.send(intent)
    except ConfigError as error:
        assert "bytes, expected at most" in str(error)
    else:
        assert mailbox.newest() == sent


@pytest.mark.parametrize(
    ("make", "reason"),
    [
        (
            lambda: from_content({"hand": {"side": "up", "place": [0, 0, 0]}}),
            "hand: side: expected one of: left, right",
        ),
        (lambda: Hand("left", (0.1, math.nan, 0.0)), "hand: place: expected .*, finite and within ±2; found nan"),
        (
            lambda: Hand("left", (0.1, 0.0, 0.0), in_s=-1.0),
            "in_s: expected seconds, finite and within 0 to 10; found -1",
        ),
        (
            lambda: FootPlace("left", (0.1, math.inf)),
            r"foot: place: expected \[x, y\], finite and within ±1; found inf",
        ),
        (lambda: FootPlace("left", (0.1, 0.1, 0.0)), r"foot: place: expected 2 numbers, \[x, y\]; found"),  # type: ignore[arg-type]
        (lambda: FootPlace("left", (0.1, 0.1), 4.0), "foot: heading: expected radians, finite and within ±3.14159"),
        (lambda: Look((0.0, 0.0, 0.0)), "look: direction: expected a direction of length"),
        (lambda: JointAngle("", 1.0), "joint: expected the name of a joint"),
        (lambda: JointAngle("l_el", 9.0), "joint: angle: expected radians, finite and within ±6.28319; found 9"),
        (lambda: from_content({"hand": {"side": "left"}}), "hand: expected the fields side, place, in_s, tolerance"),
        (lambda: from_content({"look": {"where": 3}}), "look: expected the fields direction, in_s, tolerance; found"),
    ],
)
def test_a_part_that_is_not_valid_is_refused_with_what_is(make: Callable[[], Intent], reason: str) -> None:
    with pytest.raises(ConfigError, match=reason):
        make()


@pytest.mark.parametrize("content", [{"heading": 90}, {"heading": [-90, 0.5]}, {"waypoint": [1.0, 0.0, 90]}])
def test_a_heading_in_degrees_is_refused_with_the_unit(content: dict[str, Any]) -> None:
    """A heading of 90, meant in degrees, was turned to as 90 rad."""
    with pytest.raises(ConfigError, match=r"heading rad.*, finite and within ±6.28319; found -?90"):
        from_content(content)


@pytest.mark.parametrize("make", [lambda: Heading(90.0), lambda: Waypoint(1.0, 0.0, -90.0)])
def test_a_heading_in_degrees_is_refused_from_a_program_as_well(make: Callable[[], Intent]) -> None:
    """Scripts and the gateway refused it; `session.send(Heading(90))` was accepted and turned to 117°."""
    with pytest.raises(ConfigError, match=r"heading rad.*, finite and within ±6.28319; found -?90"):
        make()


def test_two_at_once_are_refused() -> None:
    with pytest.raises(ConfigError, match="exactly one of: clip, .*, waypoint, stop, .*; found text and stop"):
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
