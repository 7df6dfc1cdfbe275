"""Meaning of sentences."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from flexmotion.text import prompt_reader
from flexmotion.text.listener import Listener
from flexmotion.text.prompt_reader import PromptReader
from flexmotion.text.sayings import NOTHING
from flexmotion.text.word_pieces import WordPieces

KINDS = ("turn-left", "turn-left", "turn-right", "turn-right", "stand", "bow", "bow", "bow", "walk")
WORDINGS = np.array(
    [
        *([1.0, 0.2, 0.1], [1.0, 0.25, -0.1], [1.0, -0.2, 0.1], [1.0, -0.25, -0.1]),
        [0.0, 0.0, 1.0],
        *([-1.0, 0.65, 0.0], [-1.0, 0.67, 0.03], [-1.0, 0.66, -0.03], [-1.0, 0.05, 0.0]),
    ]
)
HEARD = ("turn-left", "turn-right", "stand", "bow", "walk", NOTHING)

Heard = Callable[..., prompt_reader.Prompt]


class Encoder:
    """Returns the same embedding for every sentence."""

    def __init__(self, vector: np.ndarray) -> None:
        self.vector, self.pieces = vector, WordPieces(["[UNK]", "a", "sentence", "walk", "##ing", "bow"])

    def __call__(self, sentence: str) -> np.ndarray:
        return self.vector


@pytest.fixture
def heard(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Heard:
    """Function (embedding of a sentence, sentence, share of each of HEARD) -> what it is heard as."""

    def read(
        embedding: list[float], sentence: str = "a sentence", offered: tuple[str, ...] | None = None, **shares: float
    ) -> prompt_reader.Prompt:
        vector = np.array(embedding, np.float32)
        encoder = Encoder(vector / np.linalg.norm(vector))
        monkeypatch.setattr(prompt_reader, "SentenceEncoder", lambda _folder: encoder)
        known = (WORDINGS / np.linalg.norm(WORDINGS, axis=1, keepdims=True)).astype(np.float32)
        weights = np.zeros((4, len(HEARD)), np.float32)
        weights[-1] = np.log([shares.get(kind.replace("-", "_"), 1e-3) for kind in HEARD])
        listener = Listener(HEARD, np.array([], np.int32), weights)
        return PromptReader(tmp_path, KINDS, known, listener, offered)(sentence)

    return read


@pytest.mark.parametrize(("side", "kind"), [(0.04, "turn-left"), (-0.04, "turn-right")])
def test_sides_are_not_mixed(heard: Heard, side: float, kind: str) -> None:
    # Regression: embeddings of left and right are nearly equal; mixed over both, the robot went straight.
    prompt = heard([1.0, side, 0.0], **{kind.replace("-", "_"): 0.9})
    assert prompt.kind == kind and prompt.known and prompt.likeness < prompt_reader.SAME
    assert abs(prompt.embedding[1]) > 0.15 and np.sign(prompt.embedding[1]) == np.sign(side)
    assert np.linalg.norm(prompt.embedding) == pytest.approx(1.0, abs=1e-6)


def test_the_listener_decides_over_the_nearest_wording(heard: Heard) -> None:
    # Regression: "bring your left arm up in the air" was nearest to a wording about the right arm.
    prompt = heard([-1.0, 0.2, 0.0], bow=0.9)
    assert prompt.kind == "bow" and prompt.likeness == pytest.approx(0.989, abs=1e-3)
    assert prompt.embedding[1] > 0.5


def test_known_wordings_are_not_classified(heard: Heard) -> None:
    assert heard([-1.0, 0.06, 0.0], bow=0.9).kind == "walk"


@pytest.mark.parametrize("shares", [{NOTHING: 0.9}, {"bow": 0.4, "walk": 0.4, NOTHING: 0.2}])
def test_unclear_sentences_mean_standing_with_a_warning(heard: Heard, shares: dict[str, float]) -> None:
    prompt = heard([0.3, 1.0, 0.3], **shares)
    assert (prompt.kind, prompt.known) == ("stand", False)
    np.testing.assert_allclose(prompt.embedding, [0.0, 0.0, 1.0], atol=1e-6)
    assert "not understood by this model" in str(prompt.warning)


@pytest.mark.parametrize("sentence", ["", "?!", "вперёд", "zz qq"])
def test_unknown_words_have_no_meaning(heard: Heard, sentence: str) -> None:
    """Without known word pieces a listener would return the most frequent kind."""
    assert not heard([-1.0, 0.3, 0.0], sentence, walk=0.9).known


@pytest.mark.parametrize("sentence", ["do not walk", "Don't walk!", "never bow", "walk? No", "stop that walking"])
def test_prohibited_motions_are_not_made(heard: Heard, sentence: str) -> None:
    # Regression: "do not walk" was walked.
    prompt = heard([-1.0, 0.35, 0.0], sentence, walk=0.9)
    assert prompt.kind == "stand" and "prohibition" in str(prompt.warning)


@pytest.mark.parametrize(
    "sentence", ["take note and bow", "bow at noon", "a bow, no hurry", "bow without turning round", "bow non-stop"]
)
def test_words_that_resemble_a_negation_are_no_prohibition(heard: Heard, sentence: str) -> None:
    assert heard([-1.0, 0.35, 0.0], sentence, bow=0.9).kind == "bow"


def test_a_kind_that_the_model_does_not_offer_is_refused_by_name(heard: Heard) -> None:
    """Regression: kinds that a model had been taught and cannot do were offered like all others."""
    prompt = heard([-1.0, 0.35, 0.0], "a bow", ("walk", "turn-left"), bow=0.9)
    assert (prompt.kind, prompt.known, prompt.refused) == ("stand", False, "bow")
    told = "'a bow': this model cannot bow yet, it stands still; try: walk forward, turn left"
    told += "; it can: turn left, stand, walk"
    assert prompt.warning == told  # the nearest wordings first
    assert heard([-1.0, 0.35, 0.0], "a bow", ("bow",), bow=0.9).kind == "bow"


def test_motions_that_hit_are_never_suggested(heard: Heard, monkeypatch: pytest.MonkeyPatch) -> None:
    # Regression: "juggle five balls" was answered with "try: punch, slash", a button of the page beside the robot.
    kinds = tuple("punch" if kind == "bow" else kind for kind in KINDS)
    monkeypatch.setitem(globals(), "KINDS", kinds)
    told = str(heard([-1.0, 0.35, 0.0], "juggle five balls", ("punch", "walk", "turn-left"), **{NOTHING: 0.9}).warning)
    assert "; try: walk forward, turn left; it can: " in told and told.endswith(" punch, walk")


def test_a_manner_that_is_not_offered_is_dropped(heard: Heard) -> None:
    prompt = heard([-1.0, 0.35, 0.0], "bow proudly", bow=0.9)
    assert (prompt.kind, prompt.manner, prompt.dropped) == ("bow", "normal", ("proudly",))
    assert heard([0.0, 0.0, 1.0], "stand proudly").dropped == ("proudly",)
