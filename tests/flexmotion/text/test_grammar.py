"""The grammar alone: requests, amounts and their order, for any sentence."""

from __future__ import annotations

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from flexmotion.text.amounts import Amount, tokens_of
from flexmotion.text.clause import Asks
from flexmotion.text.grammar import parse
from flexmotion.text.sayings import sayings
from flexmotion.text.vocabulary import vocabulary

WORDS = sorted(
    {
        *vocabulary().table["numbers"],
        *vocabulary().units,
        *vocabulary().verbs,
        *vocabulary().table["directions"],
        *("and", "then", "after", "before", "while", "don't", "not", "never", "no", "stop", ",", ".", "to", "the", "a"),
        *("left", "right", "90", "2.5", "-3", "°", "faster", "slower", "again", "until", "half", "quarter", "twice"),
    }
)
PHRASES = st.lists(st.sampled_from(WORDS), max_size=14).map(" ".join)


def amounts(sentence: str) -> list[tuple[float, str]]:
    return [(round(one.value, 4), one.quantity) for one in tokens_of(sentence) if isinstance(one, Amount)]


@pytest.mark.parametrize(
    ("sentence", "value", "quantity"),
    [
        ("turn 90 degrees", math.pi / 2, "angle"),
        ("turn forty-five degrees", math.pi / 4, "angle"),
        ("one hundred and eighty degrees", math.pi, "angle"),
        ("three quarters of a turn", 1.5 * math.pi, "angle"),
        ("half a turn", math.pi, "angle"),
        ("3/4 of a turn", 1.5 * math.pi, "angle"),
        ("1 1/2 turns", 3 * math.pi, "angle"),
        ("two lateral steps", 2.0, "steps"),
        ("1.5m forward", 1.5, "length"),
        ("a metre and a half", 1.5, "length"),
        ("one and a half metres", 1.5, "length"),
        ("walk 1,000 metres", 1000.0, "length"),
        ("3 feet", 0.9144, "length"),
        ("two point five metres", 2.5, "length"),
        ("-2 metres", -2.0, "length"),
        ("a couple of steps", 2.0, "steps"),
        ("two big steps", 2.0, "steps"),
        ("half a minute", 30.0, "time"),
        ("twice", 2.0, "times"),
        ("two waves", 2.0, "times"),
    ],
)
def test_an_amount_is_read_in_words_and_digits(sentence: str, value: float, quantity: str) -> None:
    assert amounts(sentence) == [(round(value, 4), quantity)]


@pytest.mark.parametrize("sign", ["-", "\N{MINUS SIGN}", "\N{MINUS SIGN} ", "\N{EN DASH}", "minus ", "negative "])
@pytest.mark.parametrize("number", ["2", "two", "half a", ".5"])
def test_a_sign_is_read_whatever_character_or_word_it_is(sign: str, number: str) -> None:
    """The robot walked two metres ahead for "-two metres", and for two with a typeset minus sign."""
    ((value, _),) = amounts(f"walk {number} metres")
    assert amounts(f"walk {sign}{number} metres") == [(-value, "length")]


@pytest.mark.parametrize(
    "sentence", ["walk forward - 2 steps", "walk forward \N{EN DASH} two steps", "a two-step walk"]
)
def test_a_dash_between_words_is_no_sign(sentence: str) -> None:
    assert amounts(sentence) == [(2.0, "steps")]


@pytest.mark.parametrize(
    "speed", ["at -50 % speed", "at minus half speed", "-50 % faster", "with minus half the speed"]
)
def test_no_speed_is_below_nothing(speed: str) -> None:
    """The sign was not read, or the speed taken for the least one there is."""
    (clause,) = parse(f"walk {speed}")
    assert clause.refusal is not None


@pytest.mark.parametrize("angle", ["minus 90", "minus ninety", "negative ninety"])
def test_an_angle_without_its_unit_has_a_sign_too(angle: str) -> None:
    """The robot turned by +90° for "turn left minus 90"."""
    (clause,) = parse(f"turn left {angle}")
    assert clause.amount is not None and clause.amount.value == pytest.approx(-math.pi / 2)


@pytest.mark.parametrize(
    "sentence", ["take a turn left", "stand on one foot", "stop at once", "walk in a circle", "raise one hand"]
)
def test_words_that_only_look_like_an_amount_are_none(sentence: str) -> None:
    assert amounts(sentence) == []


def test_a_request_comes_without_its_amount_and_in_the_order_of_doing() -> None:
    clauses = parse("Wave after you turn 90 degrees to the right, then take two steps back")
    assert [clause.text for clause in clauses] == ["turn to the right", "wave", "step back"]
    assert [None if c.amount is None else str(c.amount) for c in clauses] == ["90°", None, "2 steps"]


def test_one_motion_of_two_verbs_is_not_split() -> None:
    """A hand was raised and then waved, with the hand that had come down in between."""
    assert [clause.text for clause in parse("raise the right hand and wave")] == ["raise the right hand and wave"]
    assert len(parse("raise the right hand and bow")) == 2


@pytest.mark.parametrize(
    ("sentence", "forbidden"),
    [
        ("don't walk then wave", [True, False]),
        ("don't walk, wave", [True, False]),
        ("don't walk and wave", [True, True]),
        ("do not walk or wave", [True, True]),
        ("never walk, turn or wave", [True, True, True]),
        ("wave but don't walk", [False, True]),
        ("walk without waving", [False, True]),
    ],
)
def test_a_prohibition_reaches_as_far_as_and_and_or(sentence: str, forbidden: list[bool]) -> None:
    assert [clause.forbidden for clause in parse(sentence)] == forbidden


@pytest.mark.parametrize(
    "sentence", ["look to the left", "glance back", "turn your head right", "please look up", "gaze at the sky"]
)
def test_looking_is_told_from_turning_before_a_listener_hears_it(sentence: str) -> None:
    """The words "look to the left" were heard as turning left, and the robot walked in a curve."""
    (clause,) = parse(sentence)
    assert clause.needs_head and clause.refusal is None


@pytest.mark.parametrize(
    ("sentence", "text", "amount"),
    [
        ("walk like a ninety year old", "walk like a ninety year old", None),
        ("walk as if you were eighty for five seconds", "walk as if you were eighty", "5 s"),
        ("turn 90 degrees to the left angrily", "turn to the left angrily", "90°"),
        ("walk two steps without confidence", "walk without confidence", "2 steps"),
        ("spin around once like a child", "turn to the right like a child", "360°"),
    ],
)
def test_words_of_a_manner_are_no_amount_and_no_prohibition_and_stay(
    sentence: str, text: str, amount: str | None
) -> None:
    (clause,) = parse(sentence)
    assert (clause.text, clause.refusal, clause.forbidden) == (text, None, False)
    assert (None if clause.amount is None else str(clause.amount)) == amount


def test_watch_out_is_no_looking() -> None:
    (clause,) = parse("look out")
    assert clause.refusal is None and clause.text == "look out"


def test_an_adverb_in_front_belongs_to_the_request_behind_it() -> None:
    """An adverb in front ("at half the speed, walk forward") was refused as a change of a speed while nothing moved."""
    (clause,) = parse("at half the speed, walk forward for ten seconds")
    assert (clause.text, clause.speed) == ("walk forward", 0.5)
    assert [clause.asks for clause in parse("slower, walk")][:1] == [Asks.SLOWER]


def test_no_list_of_words_holds_what_yaml_reads_as_true() -> None:
    """YAML read the word "on" of a list as `true`, so that "on the other side" was not understood."""
    lists = [words for words in vocabulary().table.values() if isinstance(words, list)]
    assert all(isinstance(word, str) for words in lists for word in words)


@pytest.mark.parametrize(
    ("sentence", "asks"),
    [
        ("faster", Asks.FASTER),
        ("walk a little faster please", Asks.FASTER),
        ("slow down", Asks.SLOWER),
        ("do that again", Asks.AGAIN),
        ("for five seconds", Asks.CONTINUE),
        ("keep going", Asks.CONTINUE),
        ("two steps", Asks.MOTION),
    ],
)
def test_requests_about_what_is_under_way(sentence: str, asks: Asks) -> None:
    assert [clause.asks for clause in parse(sentence)] == [asks]


def test_a_sentence_that_names_no_amount_and_no_order_reaches_the_listener_unchanged() -> None:
    """What the listener was taught, and measured on, must not be rewritten before it hears it."""
    changed = []
    for kind, sentence in sayings():
        clauses = parse(sentence)
        plain = len(clauses) == 1 and clauses[0].amount is None and clauses[0].asks is Asks.MOTION
        if plain and clauses[0].speed == 1.0 and not (clauses[0].counted or clauses[0].refusal or clauses[0].forbidden):
            changed += [(kind, sentence, clauses[0].text)] if clauses[0].text != sentence else []
    shares = len(changed) / len(sayings())
    assert shares < 0.02, changed


@given(st.text(max_size=60) | PHRASES)
@settings(max_examples=400, deadline=None)
def test_any_sentence_gives_requests(sentence: str) -> None:
    clauses = parse(sentence)
    assert clauses
    for clause in clauses:
        assert clause.speed > 0.0 and clause.times >= 1
        assert clause.amount is None or math.isfinite(clause.amount.value)


@given(
    st.sampled_from(["don't", "do not", "never", "you must not", "please don't"]),
    st.sampled_from(["walk forward", "turn left", "wave", "go back", "run"]),
    st.sampled_from(["", " and ", " or ", " then ", ", "]),
    st.sampled_from(["bow", "raise both arms", "step to the left"]),
)
@settings(deadline=None)
def test_what_follows_a_prohibition_word_is_forbidden(no: str, verb: str, joint: str, other: str) -> None:
    clauses = parse(f"{no} {verb}{joint}{other if joint else ''}")
    asked = " ".join(clause.text for clause in clauses if not clause.forbidden)
    assert verb not in asked
    if joint in (" and ", " or "):
        assert all(clause.forbidden for clause in clauses)


@pytest.mark.parametrize(
    ("sentence", "motion", "times"),
    [
        ("repeat the turn", "turn", 1),
        ("repeat your last bow twice", "bow", 2),
        ("do the wave once more", "wave", 1),
        ("the same turn again", "turn", 1),
        ("redo that walk", "walk", 1),
        ("turn again", "turn", 1),
        ("repeat that", "", 1),
    ],
)
def test_a_repeat_may_name_its_motion(sentence: str, motion: str, times: int) -> None:
    """The turn of "repeat the turn" was left to the listener, which heard a stand in it."""
    (clause,) = parse(sentence)
    assert (clause.asks, clause.text, clause.times) == (Asks.AGAIN, motion, times)


@pytest.mark.parametrize("sentence", ["do a turn to the left", "take the first step", "repeat after me", "wave again"])
def test_other_requests_are_no_repeats_of_a_named_motion(sentence: str) -> None:
    assert all(clause.asks is Asks.MOTION for clause in parse(sentence))


@pytest.mark.parametrize(
    ("sentence", "asks"),
    [
        ("hurry a little", Asks.FASTER),
        ("rush slightly more", Asks.FASTER),
        ("walk a bit brisker", Asks.FASTER),
        ("don't hurry so much", Asks.SLOWER),
        ("no need to rush", Asks.SLOWER),
        ("that's much too quick", Asks.SLOWER),
        ("slow down by a lot", Asks.SLOWER),
        ("hurry to the left a little", Asks.MOTION),
    ],
)
def test_a_little_hurry_changes_the_speed_of_the_motion_under_way(sentence: str, asks: Asks) -> None:
    """A little hurry was a run from wherever the robot was, and "don't hurry" a stop."""
    assert [clause.asks for clause in parse(sentence)] == [asks]


@pytest.mark.parametrize(
    ("sentence", "forbidden"),
    [
        ("walk without shoes", [False, True]),
        ("walk forward with no arm swing", [False, True]),
        ("bow without looking down", [False, True]),
        ("walk back without looking back", [False]),
        ("turn right without hesitation", [False]),
        ("walk on, no rush", [False]),
    ],
)
def test_a_prohibition_behind_a_request_forbids_no_more_than_it_names(sentence: str, forbidden: list[bool]) -> None:
    """The robot stood for "walk without shoes", and said that nothing was asked for."""
    assert [clause.forbidden for clause in parse(sentence)] == forbidden


@pytest.mark.parametrize(
    ("sentence", "text", "amount"),
    [
        ("walk one meter forward, no, backward", "walk backward", "1 m"),
        ("walk one meter forward, no, back", "back", "1 m"),
        ("walk two steps forward, sorry, go back", "go back", "2 steps"),
        ("turn left 90 degrees, no, turn right", "turn right", "90°"),
        ("walk 1 m, no, turn left", "turn left", None),
    ],
)
def test_a_corrected_direction_keeps_the_amount(sentence: str, text: str, amount: str | None) -> None:
    """The words "walk one meter forward, no, backward" were a walk back without an end."""
    (clause,) = parse(sentence)
    assert clause.text == text and (None if clause.amount is None else str(clause.amount)) == amount


def test_a_correction_that_is_refused_stays_refused() -> None:
    """A place has no amount to keep: "walk forward 2 m, no, go to the door"."""
    (clause,) = parse("walk forward 2 m, no, go to the door")
    assert clause.refusal is not None


@pytest.mark.parametrize(
    ("sentence", "factor"), [("walk slowly", 0.6), ("walk very slowly", 0.36), ("walk quite slowly", 0.6)]
)
def test_very_slowly_is_slower_than_slowly(sentence: str, factor: float) -> None:
    """The word "very" was dropped without a word."""
    (clause,) = parse(sentence)
    assert clause.text == "walk" and clause.speed == pytest.approx(factor) and clause.dropped == ()
