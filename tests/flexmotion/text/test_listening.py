"""What people say, and how a model listens."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from configs.errors import ConfigError
from flexmotion.text.listener import Listener
from flexmotion.text.phrases import kinds, mirrored
from flexmotion.text.sayings import NOTHING, read_sayings, sayings

KINDS = ("walk", "walk-left", "walk-right", "wave-right-hand", NOTHING)
BENCHMARKS = Path(__file__).parents[3] / "benchmarks"


@pytest.fixture
def listener() -> Listener:
    """One that thinks of each kind as much as of the other, but for word pieces 7 (walk-left) and 9 (walk)."""
    weights = np.zeros((2 + 2 + 1, len(KINDS)), np.float32)
    weights[2, 1], weights[3, 0] = 6.0, 5.0
    return Listener(KINDS, np.array([7, 9], np.int32), weights)


EMBEDDING = np.array([0.6, 0.8], np.float32)


def test_a_word_counts_once_and_an_unknown_one_not_at_all(listener: Listener) -> None:
    shares = listener("a sentence", EMBEDDING, [9, 9, 9, 100])
    np.testing.assert_allclose(shares, np.array([np.exp(5), 1, 1, 1, 1]) / (np.exp(5) + 4), rtol=1e-5)


@pytest.mark.parametrize(
    ("sentence", "not_meant"),
    [
        ("to the right", {"walk-left"}),
        ("Right!", {"walk-left"}),
        ("clockwise", {"walk-left"}),
        ("leftwards, please", {"walk-right", "wave-right-hand"}),
        ("go counterclockwise", {"walk-right", "wave-right-hand"}),
        ("anti-clockwise", {"walk-right", "wave-right-hand"}),
        ("turn left right now", {"walk-right", "wave-right-hand"}),
        ("right now", set()),
        ("left and right", set()),
        ("stand upright", set()),
        ("on", set()),
    ],
)
def test_who_names_one_side_never_means_the_other(listener: Listener, sentence: str, not_meant: set[str]) -> None:
    """To a sentence encoder the sides are nearly one: "side-shuffle to the right" was heard as stepping left."""
    shares = listener(sentence, EMBEDDING, [7])
    assert {kind for kind, share in zip(KINDS, shares, strict=True) if share == 0.0} == not_meant


@settings(derandomize=True, max_examples=100)
@given(st.text(max_size=60), st.lists(st.integers(0, 12), max_size=20))
def test_whatever_is_said_its_shares_are_one_together(sentence: str, pieces: list[int]) -> None:
    weights = np.linspace(-90.0, 90.0, 25, dtype=np.float32).reshape(5, 5)
    shares = Listener(KINDS, np.array([7, 9], np.int32), weights)(sentence, EMBEDDING, pieces)
    assert np.isfinite(shares).all() and shares.sum() == pytest.approx(1.0, abs=1e-5)


def test_sayings_are_of_kinds_that_there_are_and_of_both_sides() -> None:
    said = sayings()
    assert {kind for kind, _ in said} == {*kinds(), NOTHING}
    assert len(set(said)) == len(said)
    rows = set(said)
    for kind, sentence in said:
        other = (mirrored(kind), mirrored(sentence))
        assert other in rows or other[1] == sentence
    assert ("wave-right-hand", "wave") in rows and ("wave-left-hand", "wave") not in rows


@pytest.mark.parametrize("name", ["hearing.yaml", "prompts.yaml"])
def test_what_is_asked_in_benchmarks_is_not_taught(name: str) -> None:
    content = yaml.safe_load((BENCHMARKS / name).read_text(encoding="utf-8"))
    asked = content.values() if isinstance(content, dict) else [row["wordings"] for row in content]
    taught = {sentence.lower().rstrip(".!") for _, sentence in sayings()}
    assert not {sentence for each in asked for sentence in each if sentence.lower().rstrip(".!") in taught}


@pytest.mark.parametrize(
    ("content", "said"),
    [
        ("- walk", "expected kinds of motion"),
        ("walk: patrol", "expected kinds of motion"),
        ("walk: [1]", "expected kinds of motion"),
        ("walk: ['']", "expected kinds of motion"),
        ("walk: [", "no YAML"),
    ],
)
def test_sayings_of_ones_own_that_are_none_are_refused(tmp_path: Path, content: str, said: str) -> None:
    file = tmp_path / "ours.yaml"
    file.write_text(content)
    with pytest.raises(ConfigError, match=said):
        read_sayings(file)
    with pytest.raises(ConfigError, match="cannot be read"):
        read_sayings(tmp_path / "none.yaml")


def test_sayings_of_ones_own_have_mirror_images(tmp_path: Path) -> None:
    file = tmp_path / "ours.yaml"
    file.write_text("walk: [patrol]\nwalk-left: [crab to the left]\n")
    assert set(read_sayings(file)) == {
        ("walk", "patrol"),
        ("walk-left", "crab to the left"),
        ("walk-right", "crab to the right"),
    }
