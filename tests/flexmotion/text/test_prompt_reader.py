"""What a sentence is heard as."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from flexmotion.text import prompt_reader
from flexmotion.text.prompt_reader import PromptReader

KINDS = ("turn-left", "turn-left", "turn-right", "turn-right", "stand", "bow", "bow", "bow", "walk")
WORDINGS = np.array(
    [
        *([1.0, 0.2, 0.1], [1.0, 0.25, -0.1], [1.0, -0.2, 0.1], [1.0, -0.25, -0.1]),
        [0.0, 0.0, 1.0],
        *([-1.0, 0.65, 0.0], [-1.0, 0.67, 0.03], [-1.0, 0.66, -0.03], [-1.0, 0.05, 0.0]),
    ]
)

Heard = Callable[..., prompt_reader.Prompt]


@pytest.fixture
def heard(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Heard:
    """Function (embedding of a sentence) -> what it is heard as."""
    said: list[np.ndarray] = []
    monkeypatch.setattr(prompt_reader, "SentenceEncoder", lambda _folder: lambda _sentence: said[-1])
    known = (WORDINGS / np.linalg.norm(WORDINGS, axis=1, keepdims=True)).astype(np.float32)
    reader = PromptReader(tmp_path, KINDS, known, 0.7)

    def read(embedding: list[float], sentence: str = "a sentence") -> prompt_reader.Prompt:
        vector = np.array(embedding, np.float32)
        said.append(vector / np.linalg.norm(vector))
        return reader(sentence)

    return read


@pytest.mark.parametrize(("side", "kind"), [(0.04, "turn-left"), (-0.04, "turn-right")])
def test_left_is_not_heard_as_half_right(heard: Heard, side: float, kind: str) -> None:
    # Left and right are nearly one to a sentence encoder: mixed over both, the robot went straight on.
    prompt = heard([1.0, side, 0.0])
    assert prompt.kind == kind and prompt.known and prompt.likeness < prompt_reader.SAME
    assert abs(prompt.embedding[1]) > 0.15 and np.sign(prompt.embedding[1]) == np.sign(side)
    assert np.linalg.norm(prompt.embedding) == pytest.approx(1.0, abs=1e-6)


def test_several_wordings_outvote_the_one_that_is_a_little_nearer(heard: Heard) -> None:
    # "bring your left arm up in the air" was nearest to a wording about the right one.
    prompt = heard([-1.0, 0.3, 0.0])
    nearest = heard([-1.0, 0.05, 0.0])
    assert prompt.kind == "bow" and prompt.likeness == pytest.approx(0.971, abs=1e-3) and nearest.kind == "walk"


def test_a_known_wording_needs_no_vote(heard: Heard) -> None:
    assert heard([-1.0, 0.06, 0.0]).kind == "walk"


def test_what_is_like_nothing_known_means_standing_and_is_told(heard: Heard, caplog: pytest.LogCaptureFixture) -> None:
    prompt = heard([0.3, 1.0, 0.3])
    assert (prompt.kind, prompt.known) == ("stand", False)
    np.testing.assert_allclose(prompt.embedding, [0.0, 0.0, 1.0], atol=1e-6)
    assert "means nothing to this model" in caplog.text


@pytest.mark.parametrize("sentence", ["do not walk", "Don't walk!", "never bow", "walk? No", "stop that walking"])
def test_who_is_told_what_not_to_do_does_not_do_it(
    heard: Heard, caplog: pytest.LogCaptureFixture, sentence: str
) -> None:
    # "do not walk" made it walk.
    assert heard([-1.0, 0.35, 0.0], sentence).kind == "stand"
    assert "what not to do" in caplog.text


@pytest.mark.parametrize("sentence", ["take note and bow", "bow at noon", "go north"])
def test_words_that_only_look_like_a_negation_are_none(heard: Heard, sentence: str) -> None:
    assert heard([-1.0, 0.35, 0.0], sentence).kind == "bow"
