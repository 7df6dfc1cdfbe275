"""Which sentences ask for a stand where no model listens."""

from __future__ import annotations

import pytest

from flexmotion.text.standing import asks_to_stand


@pytest.mark.parametrize(
    "sentence",
    [
        "stop",
        "Stop.",
        "stand still",
        "please stop",
        "don't move",
        "freeze",
        "wait",
        "stop mirroring me",
        "stop!",
        "halt",
    ],
)
def test_a_stand_is_understood_without_a_model(sentence: str) -> None:
    """A run that plays a clip or mirrors a person refused "stop"."""
    assert asks_to_stand(sentence)


@pytest.mark.parametrize(
    "sentence",
    [
        "mirror",
        "walk",
        "walk then stop",
        "stop and wave",
        "don't stop",
        "never stop",
        "lower your right hand",
        "wave",
        "?",
    ],
)
def test_other_sentences_are_none(sentence: str) -> None:
    assert not asks_to_stand(sentence)
