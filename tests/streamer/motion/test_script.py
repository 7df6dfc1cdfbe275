"""Scripts: errors name the line and what would be valid."""

from __future__ import annotations

from pathlib import Path

import pytest

from flexmotion.configs.errors import ConfigError
from flexmotion.streamer.motion.intents import Clip, Stop, Text, Velocity, Waypoint
from flexmotion.streamer.motion.script import Item, load_script


def script(folder: Path, text: str) -> Path:
    file = folder / "script.yaml"
    file.write_text(text, encoding="utf-8")
    return file


def test_items_in_order_with_clips_beside_the_script(tmp_path: Path) -> None:
    file = script(tmp_path, "- {at: 0, clip: a.bvh}\n- at: 2.5\n  clip: /b/c.bvh\n- {at: 4, stop: true}\n")
    clips = [Item(0.0, Clip(str(tmp_path / "a.bvh"))), Item(2.5, Clip("/b/c.bvh"))]
    assert load_script(file) == [*clips, Item(4.0, Stop())]


def test_text_and_velocity_in_one_script(tmp_path: Path) -> None:
    file = script(tmp_path, "- {at: 0, text: wave}\n- {at: 3, velocity: [0.5, 0, -1]}\n- {at: 5, text: bow}\n")
    asked = [Item(0.0, Text("wave")), Item(3.0, Velocity(0.5, 0.0, -1.0)), Item(5.0, Text("bow"))]
    assert load_script(file) == asked


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        (
            "- {at: 0, clip: a.bvh}\n- {at: 1,\n   dance: true}\n",
            "line 3: unknown word 'dance', expected at and one of",
        ),
        ("- {at: 0, clip: a.bvh, stop: true}\n", "line 1: expected exactly one of: clip, text, velocity, heading, "),
        ("- {at: 0}\n", "line 1: expected exactly one of"),
        ("- {at: soon, clip: a.bvh}\n", "line 1: at: expected seconds from the start, found 'soon'"),
        ("- {at: -1, clip: a.bvh}\n", "line 1: at: expected seconds"),
        ("- {at: .inf, clip: a.bvh}\n", "line 1: at: expected seconds"),
        ("- {at: .nan, clip: a.bvh}\n", "line 1: at: expected seconds"),
        ("- {clip: a.bvh}\n", "line 1: at: expected seconds from the start, found None"),
        ("- {at: 0, text: ''}\n", "line 1: text: expected words that say what to do, found ''"),
        ("- {at: 0, text: 3}\n", "line 1: text: expected words that say what to do, found 3"),
        (
            "- {at: 0, velocity: [1, 0]}\n",
            "line 1: velocity: expected [forward m/s, left m/s, turning rad/s], found [1, 0]",
        ),
        ("- {at: 0, velocity: [1, 0, x]}\n", "line 1: velocity: expected [forward m/s"),
        ("- {at: 0, velocity: [.nan, 0, 0]}\n", "line 1: velocity: expected [forward m/s"),
        ("- {at: 0, waypoint: [1]}\n", "line 1: waypoint: expected [x m, y m], [x, y, heading rad or null]"),
        ("- {at: 0, waypoint: [1, 0, null, 5]}\n", "line 1: waypoint: expected [x m, y m]"),
        ("- {at: 0, heading: north}\n", "line 1: heading: expected [heading rad]"),
        ("- {at: 0, velocity: 1}\n", "line 1: velocity: expected [forward m/s, left m/s, turning rad/s], found 1"),
        ("- {at: 0, velocity: [9, 0, 0]}\n", "within [±3, ±1.5, ±3], found [9, 0, 0]"),
        ("- {at: 0, text: wave}\n- {at: 1, clip: a.bvh}\n", "line 2: clip after text: a script is either of clips"),
        ("- {at: 0, clip: a.bvh}\n- {at: 1, velocity: [1, 0, 0]}\n", "line 2: velocity after clip: a script is either"),
        ("- {at: 0, clip: a.bvh}\n- {at: 0, clip: b.bvh}\n", "line 2: at: 0 does not come after 0"),
        ("- {at: 0, clip: a.bvh}\n- {at: 1, stop: true}\n- {at: 2, clip: b.bvh}\n", "line 3: nothing may follow stop"),
        ("- {at: 1, clip: a.bvh}\n", "line 1: a script starts with something to do at: 0"),
        ("- {at: 0, stop: true}\n", "line 1: a script starts with"),
        ("- {at: 0, clip: [a]}\n", "line 1: clip: expected a file or a name, found ['a']"),
        ("- {at: 0, clip: a.bvh}\n- {at: 1, stop: maybe}\n", "line 2: stop: expected true, found 'maybe'"),
        ("- wave\n", "line 1: expected {at: seconds"),
        ("at: 0\n", "expected a list of {at: seconds"),
        ("", "expected a list of {at: seconds"),
        ("- {at: 0, clip: a.bvh}\n- {at: 1, txt: walk\n", "line 3: not valid YAML: expected"),
    ],
)
def test_refused(text: str, expected: str, tmp_path: Path) -> None:
    file = script(tmp_path, text)
    with pytest.raises(ConfigError) as error:
        load_script(file)
    assert str(error.value).startswith(str(file))
    assert expected in str(error.value)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    "part", ["contact: {foot: left}", "torque: {joint: knee, limit: 1}", "tension: {limb: head, tension: 0}", "hand: 3"]
)
def test_what_is_sent_to_a_run_is_refused_and_is_not_among_what_is_expected(part: str, tmp_path: Path) -> None:
    """The list of what is expected named contact, which the next line refused."""
    word = part.partition(":")[0]
    for item in (f"{{at: 0, {part}}}", f"{{at: 0, text: wave, {part}}}"):
        with pytest.raises(
            ConfigError, match=rf"line 1: {word} is sent to a run \(flexmotion send\); expected"
        ) as error:
            load_script(script(tmp_path, f"- {item}\n"))
        assert str(error.value).count(word) == 1
    for item in ("{at: 0}", "{at: 0, dance: true}"):
        with pytest.raises(ConfigError) as error:
            load_script(script(tmp_path, f"- {item}\n"))
        assert word not in str(error.value) and "text, velocity, heading, waypoint, stop" in str(error.value)


@pytest.mark.parametrize(
    ("number", "value"),
    [("-.1", -0.1), (".5", 0.5), ("+.25", 0.25), ("1e-1", 0.1), ("-2E-1", -0.2), ("1.e-1", 0.1), ("5e-1", 0.5)],
)
def test_numbers_are_read_as_the_documents_write_them(number: str, value: float, tmp_path: Path) -> None:
    """The numbers "-.1" and "1e-1" were words: PyYAML reads YAML 1.1."""
    file = script(tmp_path, f"- {{at: 0e0, velocity: [{number}, 0, 0]}}\n- {{at: 1e9, waypoint: [{number}, 0]}}\n")
    (first, second) = load_script(file)
    assert first == Item(0.0, Velocity(value, 0.0, 0.0))
    assert second.at == 1e9 and second.intent == Waypoint(value, 0.0)


@pytest.mark.parametrize("words", ["'1e9'", '"-.1"', "1e9 steps", "e9", "-", "1.2.3"])
def test_what_is_quoted_or_no_number_stays_words(words: str, tmp_path: Path) -> None:
    (item,) = load_script(script(tmp_path, f"- {{at: 0, text: {words}}}\n"))
    assert item.intent == Text(words.strip("'\""))


def test_missing_file(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="cannot be read"):
        load_script(tmp_path / "none.yaml")
