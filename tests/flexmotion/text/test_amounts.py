"""Amounts of sentences are looked for only where one can begin."""

from __future__ import annotations

import math

import pytest

from flexmotion.text import amounts
from flexmotion.text.amounts import Amount, tokens_of, words_of
from flexmotion.text.grammar import parse
from flexmotion.text.paces import Rate
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


def rates(sentence: str) -> list[Rate]:
    return [token for token in tokens_of(sentence) if isinstance(token, Rate)]


@pytest.mark.parametrize("sentence", ["walk triumphantly", "wave emphatically", "conduct a symphony"])
def test_letters_of_a_unit_inside_a_word_are_no_unit(sentence: str) -> None:
    """The words "walk triumphantly" were read as "walk triu miles per hour antly", and refused for "per hour"."""
    assert words_of(sentence) == sentence.split()
    assert all(clause.refusal is None or "per" not in clause.refusal for clause in parse(sentence))
    for said in ("walk at 3 mph", "walk at 3mph", "walk at three miles per hour", "walk at 3 miles an hour"):
        assert [rate.value for rate in rates(said)] == pytest.approx([1.34112])


def test_a_slash_is_that_of_a_speed_only_behind_its_unit() -> None:
    """The words "raise your hand/s" became "raise your hand per s", and a refusal quoted "0.3 m per s"."""
    assert words_of("raise your hand/s") == ["raise", "your", "hand", "s"]
    for said in ("0.3 m/s", "30 cm/sec", "0.3m / s", "20 degrees/s", "3 km/h"):
        (rate,) = rates(f"walk at {said}")
        assert rate.said.replace(" ", "") == said.replace(" ", "")


@pytest.mark.parametrize(
    ("sentence", "amounts_said"),
    [
        ("walk 3 metres a second after that wave", ["3 metres", "a second"]),
        ("walk 2 metres a second after you wave", ["2 metres", "a second"]),
        ("walk 2 metres a second later wave", ["2 metres", "a second"]),
        ("walk 2 metres a second before you wave", ["2 metres", "a second"]),
        ("walk 2 metres a second then wave", ["2 metres", "a second"]),
        ("walk 2 metres a while", ["2 metres", "a while"]),
        ("walk 2 metres a moment", ["2 metres", "a moment"]),
    ],
)
def test_a_length_and_a_time_behind_it_are_no_speed(sentence: str, amounts_said: list[str]) -> None:
    """A walk of 3 m, "a second after that" a wave, was a walk at 3 m/s; "2 metres a while" was one at .4 m/s."""
    tokens = tokens_of(sentence)
    assert not rates(sentence)
    assert [token.said for token in tokens if isinstance(token, Amount)] == amounts_said


def test_a_speed_that_is_said_to_be_one_is_one_whatever_follows() -> None:
    """Without "at", "walk 2 metres a second then wave" is no speed; with it, it stays one."""
    for sentence in (
        "walk at 2 metres a second then wave",
        "walk at a speed of about 2 metres a second after you wave",
    ):
        assert [rate.value for rate in rates(sentence)] == [2.0]


@pytest.mark.parametrize(
    ("sentence", "said"),
    [
        ("walk at 0.3 to 0.5 m/s", "0.3 to 0.5 m/s"),
        ("walk at 0.3-0.5 m/s", "0.3-0.5 m/s"),
        ("walk between 0.3 and 0.5 m/s", "0.3 and 0.5 m/s"),
        ("walk at 0.3 or 0.5 metres per second", "0.3 or 0.5 metres per second"),
        ("walk at a few metres per second", "a few metres per second"),
        ("walk 2 metres per 5 seconds", "2 metres per 5 seconds"),
        ("walk 20 cm per 1 second", "20 cm per 1 second"),
        ("walk at 0.3 m per day", "0.3 m per day"),
        ("walk at 0.3 m/day", "0.3 m/day"),
        ("walk 2 m/s/s", "2 m/s/s"),
        ("walk 2 m/s²", "2 m/s²"),
        ("walk two steps per second", "two steps per second"),
    ],
)
def test_what_is_no_one_speed_is_refused_by_name(sentence: str, said: str) -> None:
    """A walk "at 0.3 to 0.5 m/s" was one of 0.5 m at 1.1 m/s, and one "between 0.3 and 0.5" was at 0.8."""
    (clause,) = parse(sentence)
    assert clause.refusal is not None and f"{said!r}: expected" in clause.refusal
    assert "as in 'walk forward at 0.5 m/s'" in clause.refusal


def test_two_numbers_behind_between_are_not_added() -> None:
    """A walk "between 0.3 and 0.5 metres" was one of 0.8 m."""
    amount = parse("walk between 0.3 and 0.5 metres")[0].amount
    assert amount is not None and amount.rough and amount.value == pytest.approx(0.4)
    whole = parse("walk 2 and 1/2 metres")[0].amount
    assert whole is not None and whole.value == pytest.approx(2.5)


def test_per_without_a_number_is_a_word() -> None:
    """A refusal of every "per" would refuse "walk as per usual"."""
    assert all(clause.refusal is None for clause in parse("walk as per usual"))


@pytest.mark.parametrize(
    ("said", "degrees"),
    [
        ("pi/2 radians", 90.0),
        ("pi / 3 rad", 60.0),
        ("3*pi/4 radians", 135.0),
        ("3π/4 radians", 135.0),
        ("two pi radians", 360.0),
        ("half pi radians", 90.0),
    ],
)
def test_parts_and_multiples_of_pi_are_numbers(said: str, degrees: float) -> None:
    """The words "turn pi/2 radians left" turned by 2 rad: the "pi/" was lost."""
    amount = parse(f"turn {said} left")[0].amount
    assert amount is not None and math.degrees(amount.value) == pytest.approx(degrees)


@pytest.mark.parametrize("said", ["pi/foo", "pi/0", "pi/", "2+pi/4", "1/pi", "2 + pi"])
def test_no_other_sum_or_fraction_is_made_with_pi(said: str) -> None:
    """The words "turn pi/foo radians left" turned on without an end."""
    (clause,) = parse(f"turn {said} radians left")
    assert clause.refusal is not None and "expected a multiple of pi" in clause.refusal


@pytest.mark.parametrize(
    "sentence",
    ["walk two", "walk two forward", "walk for two", "walk one", "turn left two", "wave two", "walk two metrs"],
)
def test_a_number_in_words_needs_a_unit_as_one_in_digits_does(sentence: str) -> None:
    """The words "walk two" were a walk without an end, while "walk 2" was refused."""
    (clause,) = parse(sentence)
    assert "no unit that is known" in str(clause.refusal) and "no unit that is known" in str(parse("walk 2")[0].refusal)


@pytest.mark.parametrize("sentence", ["walk tow metres", "walk many meters", "turn left by degrees"])
def test_a_unit_without_a_number_is_refused(sentence: str) -> None:
    """The words "walk tow metres" were a walk without an end: "tow" is a word of its own."""
    (clause,) = parse(sentence)
    assert clause.refusal is not None and "of what number?" in clause.refusal


@pytest.mark.parametrize(
    ("sentence", "meant"),
    [
        ("walk thre metres", "three"),
        ("walk fiv steps", "five"),
        ("turn left nintey degrees", "ninety"),
        ("wave thre times", "three"),
    ],
)
def test_a_misspelt_number_in_front_of_a_unit_is_refused_with_the_number(sentence: str, meant: str) -> None:
    """The words "walk thre metres" were a walk without an end."""
    (clause,) = parse(sentence)
    assert clause.refusal is not None and clause.refusal.endswith(f"expected a number; try: {meant}")


@pytest.mark.parametrize(
    "sentence",
    [
        "take dainty steps",
        "raise two hands",
        "wave with two hands",
        "wave two times",
        "take two steps",
        "walk in one line",
        "walk with two bags",
        "wave at two people",
        "walk a step or two",
        "head toward bay six",
    ],
)
def test_a_number_in_words_that_counts_or_names_something_is_not_refused(sentence: str) -> None:
    """A refusal of every number in words would refuse "raise two hands"."""
    assert all(clause.refusal is None or "number" not in clause.refusal for clause in parse(sentence))
