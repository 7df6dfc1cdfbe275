"""The listener and its sentences."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from benchmarks.model.hearing import untaught_sentences
from benchmarks.shared.prompts import gesture_kinds, prompt_kinds
from flexmotion.configs.errors import ConfigError
from flexmotion.text.listener import Listener
from flexmotion.text.phrases import STAND, kinds
from flexmotion.text.prompt_reader import forbids
from flexmotion.text.sayings import NOTHING, read_sayings, sayings
from flexmotion.text.sides import mirrored, sides

KINDS = ("walk", "walk-left", "walk-right", "wave-right-hand", NOTHING)


@pytest.fixture
def listener() -> Listener:
    """A listener with equal probabilities, except for word pieces 7 (walk-left) and 9 (walk)."""
    weights = np.zeros((2 + 2 + 1, len(KINDS)), np.float32)
    weights[2, 1], weights[3, 0] = 6.0, 5.0
    return Listener(KINDS, np.array([7, 9], np.int32), weights)


EMBEDDING = np.array([0.6, 0.8], np.float32)


def test_a_word_counts_once_and_an_unknown_one_not_at_all(listener: Listener) -> None:
    shares = listener.shares("a sentence", EMBEDDING, [9, 9, 9, 100])
    np.testing.assert_allclose(shares, np.array([np.exp(5), 1, 1, 1, 1]) / (np.exp(5) + 4), rtol=1e-5)
    assert listener("a sentence", EMBEDDING, [9]) == "walk"


@pytest.mark.parametrize(
    ("sentence", "not_meant"),
    [
        ("to the right", {"walk-left"}),
        ("Right!", {"walk-left"}),
        ("clockwise", {"walk-left"}),
        ("leftwards, please", {"walk-right", "wave-right-hand"}),
        *((word, {"walk-right", "wave-right-hand"}) for word in ("counterclockwise", "go counter-clockwise")),
        *((word, {"walk-right", "wave-right-hand"}) for word in ("anti clockwise", "anti–clockwise", "anticlockwise")),
        ("turn left right now", {"walk-right", "wave-right-hand"}),
        ("that's right, step left", {"walk-right", "wave-right-hand"}),
        ("I left it there, go right", {"walk-left"}),
        ("right now", set()),
        ("left and right", set()),
        ("stand upright", set()),
        ("on", set()),
    ],
)
def test_a_sentence_with_one_side_never_means_the_other(listener: Listener, sentence: str, not_meant: set[str]) -> None:
    """Regression: embeddings hardly separate the sides; "side-shuffle to the right" was a step to the left."""
    shares = listener.shares(sentence, EMBEDDING, [7])
    assert {kind for kind, share in zip(KINDS, shares, strict=True) if share == 0.0} == not_meant


def test_a_sentence_with_both_sides_means_one_only_if_clear() -> None:
    weights = np.zeros((3, 2), np.float32)
    weights[-1] = np.log([0.7, 0.3])
    unclear = Listener(("walk-left", "walk-right"), np.array([], np.int32), weights)
    assert unclear("left foot, right foot", EMBEDDING, []) == NOTHING
    assert unclear("on", EMBEDDING, []) == "walk-left"
    weights[-1] = np.log([0.85, 0.15])
    clear = Listener(("walk-left", "walk-right"), np.array([], np.int32), weights)
    assert clear("left foot, right foot", EMBEDDING, []) == "walk-left"


def test_strange_sentences_need_a_higher_probability() -> None:
    """Regression: "emergency" is unlike all known sentences, slightly nearest to running, and was run."""
    weights = np.zeros((3, 2), np.float32)
    weights[-1] = np.log([0.55, 0.45])
    listener = Listener(("run", NOTHING), np.array([], np.int32), weights)
    assert listener("a sentence", EMBEDDING, [], likeness=0.8) == "run"
    assert listener("a sentence", EMBEDDING, [], likeness=0.5) == NOTHING


@settings(max_examples=100)
@given(st.text(max_size=60), st.lists(st.integers(0, 12), max_size=20))
def test_probabilities_add_up_to_one(sentence: str, pieces: list[int]) -> None:
    weights = np.linspace(-90.0, 90.0, 25, dtype=np.float32).reshape(5, 5)
    shares = Listener(KINDS, np.array([7, 9], np.int32), weights).shares(sentence, EMBEDDING, pieces)
    assert np.isfinite(shares).all() and shares.sum() == pytest.approx(1.0, abs=1e-5)


def test_no_prohibition_is_taught_as_a_motion() -> None:
    """Regression: sentences like "turn left to avoid the wall" were taught, but refused as prohibitions."""
    assert not [row for row in sayings() if row[0] not in (STAND, NOTHING) and forbids(row[1], row[0])]


def test_sentences_are_of_known_kinds_and_of_both_sides() -> None:
    said = sayings()
    assert {kind for kind, _ in said} == {*kinds(), NOTHING}
    assert len(set(said)) == len(said)
    rows = set(said)
    sided = Counter(kind for kind, sentence in said if sides(sentence))
    assert sided["walk-left"] > 200 and all(
        0.9 < sided[kind] / sided[mirrored(kind)] < 1.1 for kind in sided if sides(kind)
    )
    assert ("wave-right-hand", "wave") in rows and ("wave-left-hand", "wave") not in rows


def test_sentences_of_benchmarks_are_not_taught() -> None:
    asked = {sentence for own in untaught_sentences().values() for sentence in own}
    asked |= {wording for entry in (*prompt_kinds(), *gesture_kinds()) for wording in entry.wordings}
    taught = {sentence.lower().rstrip(".!") for _, sentence in sayings()}
    assert len(asked) > 700
    assert not {sentence for sentence in asked if sentence.lower().rstrip(".!") in taught}


@pytest.mark.parametrize(
    ("content", "said"),
    [
        ("- walk", "expected kinds of motion"),
        ("walk: patrol", "walk: expected a list of sentences, found 'patrol'"),
        ("{}", "expected kinds of motion"),
        ("walk: ['']", "walk: expected a list of sentences"),
        ("walk: []", "walk: expected a list of sentences"),
        ("walk: [{a: b}]", "walk: expected a list of sentences"),
        ("walk: " + 5000 * "[", "not valid YAML"),
        ("walk: [", "not valid YAML"),
    ],
)
def test_invalid_sentences_of_a_user_are_refused(tmp_path: Path, content: str, said: str) -> None:
    file = tmp_path / "ours.yaml"
    file.write_text(content)
    with pytest.raises(ConfigError, match=said):
        read_sayings(file)
    with pytest.raises(ConfigError, match="cannot be read"):
        read_sayings(tmp_path / "none.yaml")


def test_sentences_of_a_user_have_mirror_images(tmp_path: Path) -> None:
    file = tmp_path / "ours.yaml"
    file.write_text("walk: [patrol]\nwalk-left: [crab to the left]\nstand: [no]\n")
    assert set(read_sayings(file)) == {
        ("stand", "no"),
        ("walk", "patrol"),
        ("walk-left", "crab to the left"),
        ("walk-right", "crab to the right"),
    }
