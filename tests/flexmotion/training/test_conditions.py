"""Conditions of windows."""

from __future__ import annotations

import numpy as np
import pytest

from flexmotion.configs.errors import ConfigError
from flexmotion.human.body import Body

pytest.importorskip("torch", reason="the extra 'train' is not installed")

from flexmotion.training.conditions import Sentences
from flexmotion.training.feature_store import StoredClip
from flexmotion.training.manner_conditions import NONE, Manners
from flexmotion.training.window_set import MOST_NORMAL, normal_weights


def clip(labels: dict[str, str], captions: tuple[str, ...] = ()) -> StoredClip:
    return StoredClip("walk_001", 0, 90, "train", "original", labels, captions, Body())


def embedded(_text: str) -> np.ndarray:
    return np.zeros(4)


def test_labels_and_captions_become_sentences() -> None:
    labelled = Sentences([clip({"content": "walk"}), clip({})], embedded)
    captioned = Sentences([clip({}, ("someone strolls",))], embedded)
    assert "walk forward" in labelled.texts and "someone strolls" in captioned.texts


def test_a_set_without_captions_and_labels_is_refused() -> None:
    """Regression: a set built without its index was trained on for an hour, and learnt no sentence."""
    with pytest.raises(ConfigError, match="no clip has a caption or a known label; put the collection's"):
        Sentences([clip({}), clip({"content": "unheard-of", "style": "normal"})], embedded)
    assert Sentences([clip({"content": "walk"})], embedded).texts


def test_the_manner_of_a_clip_is_given_apart_from_its_sentence() -> None:
    """Regression: two of five sentences named the style, the others were taught with every style."""
    clips = [clip({"content": "walk", "style": style}) for style in ("exhausted", "normal", "tired", "of no table")]
    assert not any("wearily" in text for text in Sentences(clips, embedded).texts)
    assert any("wearily" in text for text in Sentences(clips, embedded, named=True).texts)
    found = Manners(clips, lambda text: np.eye(3)[len(text) % 3])
    assert found.names == ("normal", "tired") and list(found.of_clip) == [1, 0, 1, NONE]
    rows, mixtures = found.draw(np.random.default_rng(0), np.array([0, 3, 2]), 3)
    assert list(rows) == [1, NONE, 1] and not mixtures[1].any()
    np.testing.assert_allclose(np.linalg.norm(mixtures[[0, 2]], axis=1), 1.0, rtol=1e-6)


def test_a_personal_manner_is_that_of_all_clips() -> None:
    found = Manners([clip({"style": "tired"}), clip({})], lambda text: np.ones(2), ("like Ada",))
    assert found.names == ("like Ada",) and list(found.of_clip) == [0, 0]


def test_normal_clips_are_a_share_of_their_kind() -> None:
    """Regression: of thirteen bows one was normal, and a bow without a manner was a mixture of the others."""
    kinds = np.array(["bow"] * 5 + ["walk"] * 3 + ["bye"])
    plain = np.array([True, False, False, False, False, True, True, False, False])
    count = np.array([10, 10, 10, 10, 10, 10, 10, 10, 10])
    weights = count * normal_weights(kinds, plain, count, 0.4)
    assert weights[:5].sum() == pytest.approx(50.0) and weights[0] == pytest.approx(20.0)
    np.testing.assert_allclose(weights[5:], 10.0)
    few = normal_weights(np.array(["bow"] * 41), np.arange(41) == 0, np.ones(41), 0.4)
    assert few[0] / few[1] == pytest.approx(MOST_NORMAL)
