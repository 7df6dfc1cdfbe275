"""Conditions of windows."""

from __future__ import annotations

import numpy as np
import pytest

from flexmotion.configs.errors import ConfigError
from flexmotion.human.body import Body

pytest.importorskip("torch", reason="the extra 'train' is not installed")

from flexmotion.training.conditions import Sentences
from flexmotion.training.feature_store import StoredClip


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
    assert Sentences([clip({})], embedded, "like me").texts
