"""Conditions of windows."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from flexmotion.configs.errors import ConfigError
from flexmotion.human.body import Body

pytest.importorskip("torch", reason="the extra 'train' is not installed")

from flexmotion.text.phrases import wordings
from flexmotion.training.conditions import MIXED, Sentences
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


def test_windows_have_the_captions_of_their_part_of_a_clip() -> None:
    """Regression: every sentence of a clip was taught for every window, whichever part of it the sentence is about."""
    said, spans = ("someone walks and stops", "someone walks", "someone waits"), ((0.0, 0.0), (0.0, 2.0), (2.0, 4.0))
    parts = replace(clip({}, said), spans=spans)
    sentences = Sentences([parts, replace(parts, variant="mirror")], embedded)
    times = np.array([[0.5, 1.5], [2.5, 3.5], [1.7, 2.7], [6.0, 7.0]])
    off = np.zeros(4, np.bool_)
    rows = sentences.draw(np.random.default_rng(0), np.zeros(4, np.intp), off, off, times)
    assert [sentences.texts[row] for row in rows] == [said[1], said[2], said[2], said[0]]
    whole = sentences.draw(np.random.default_rng(0), np.zeros(4, np.intp), off, off)
    assert {sentences.texts[row] for row in whole} == {said[0]}


def test_a_clip_that_shows_its_kind_for_a_while_is_of_it_only_then() -> None:
    """Regression: a nod moves so little that its windows were told to stand, and a held pose taught standing."""
    labels = {"content": "nod", "start_s": "1.0", "end_s": "3.0", "around": "stand"}
    found = Sentences([clip(labels, ("nod twice",)), clip({"content": "nod"})], embedded)
    rng, times = np.random.default_rng(0), np.array([[0.0, 1.0], [0.5, 1.5], [1.5, 2.5], [2.9, 3.9], [1.5, 2.5]])
    always, never = np.ones(5, np.bool_), np.zeros(5, np.bool_)
    which = np.array([0, 0, 0, 0, 1])
    for still, kinds in ((always, [0, 1, 1, 0, 0]), (never, [0, 1, 1, 0, 1])):
        rows = found.draw(rng, which, still, never, times)
        texts = [found.texts[row] for row in rows]
        said = [text in {*wordings("nod"), "nod twice"} for text in texts]
        assert said == [bool(kind) for kind in kinds]
        assert all(
            found.texts[row] in wordings("stand") for row, of_kind in zip(rows, said, strict=True) if not of_kind
        )


def test_the_way_back_from_a_pose_is_not_of_its_kind() -> None:
    """Regression: asked to hold a hand out, a model lowered it by chance: half of the windows with that label did.

    A window that leaves the pose at once is of what is around it, one that leaves it later is of nothing.
    """
    labels = {"content": "nod", "start_s": "1.0", "left_s": "3.0", "end_s": "3.6", "around": "stand"}
    found = Sentences([clip(labels)], embedded)
    times = np.array([[0.0, 1.0], [0.5, 1.5], [2.0, 3.0], [2.1, 3.1], [2.7, 3.7], [2.8, 3.8], [3.5, 4.5]])
    off = np.zeros(len(times), np.bool_)
    rows = found.draw(np.random.default_rng(0), np.zeros(len(times), np.intp), off, off, times)
    texts = ["" if row == NONE else found.texts[row] for row in rows]
    kinds = [next((kind for kind in ("nod", "stand") if text in wordings(kind)), None) for text in texts]
    assert kinds == ["stand", "nod", "nod", None, None, "stand", "stand"]


def test_a_window_that_waits_for_a_gesture_is_not_of_its_kind() -> None:
    """Regression: a nod that came at the end of a window was taught as a nod, and a model that was asked for it waited.

    A window that shows no part of it is of what is around it, whether it is told to wait or not.
    """
    labels = {"content": "nod", "start_s": "1.0", "end_s": "3.0", "around": "stand"}
    found = Sentences([clip(labels), clip({"content": "bow"})], embedded)
    times = np.array([[0.0, 1.0], [0.5, 1.5], [0.9, 1.9], [0.5, 1.5], [0.9, 1.9], [0.5, 1.5]])
    which, waits = np.array([0, 0, 0, 1, 1, 1]), np.array([True, True, False, True, False, True])
    still = np.array([False, False, False, False, False, True])
    never = np.zeros(len(times), np.bool_)
    rows = found.draw(np.random.default_rng(0), which, still, never, times, waits)
    texts = ["" if row == NONE else found.texts[row] for row in rows]
    kinds = [next((kind for kind in ("nod", "bow", "stand") if text in wordings(kind)), None) for text in texts]
    assert kinds == ["stand", None, "nod", None, "bow", "stand"]


def test_wordings_are_mixed_within_their_kind() -> None:
    """Regression: the wordings of a kind differ by more than kinds do, and a model hardly heard which kind was asked.

    An evaluator, which compares sentences, gets them as they are; so do captions.
    """
    known: dict[str, int] = {}

    def one_of_many(text: str) -> np.ndarray:
        return np.eye(400)[known.setdefault(text, len(known))]

    clips = [clip({"content": kind}, ("someone strolls",)) for kind in ("nod", "bow")]
    found, named = Sentences(clips, one_of_many), Sentences(clips, one_of_many, named=True)
    row = found.texts.index(wordings("nod")[0])
    caption = found.texts.index("someone strolls")
    drawn = found.embedded(np.array([row] * 200 + [caption, NONE]), np.random.default_rng(0)).numpy()
    np.testing.assert_allclose(np.linalg.norm(drawn, axis=1), 1.0, rtol=1e-5)
    alike = [known[text] for text in wordings("nod")]
    assert (drawn[:200] > 0).any(axis=0).nonzero()[0].tolist() == sorted(alike)
    mixed = (drawn[:200] > 0).sum(axis=1) > 1
    assert mixed.mean() == pytest.approx(MIXED, abs=0.1) and drawn[200, known["someone strolls"]] == 1.0
    assert (named.embedded(np.array([row] * 50), np.random.default_rng(0)).numpy().max(axis=1) == 1.0).all()


def test_a_wording_of_two_kinds_is_mixed_with_neither() -> None:
    """Regression: "sprint" of a clip that runs was mixed with the wordings of dashing."""
    known: dict[str, int] = {}

    def one_of_many(text: str) -> np.ndarray:
        return np.eye(400)[known.setdefault(text, len(known))]

    found = Sentences([clip({"content": kind}) for kind in ("run", "dash")], one_of_many)
    assert "sprint" in set(wordings("run")) & set(wordings("dash"))
    drawn = found.embedded(np.array([found.texts.index("sprint")] * 20), np.random.default_rng(0)).numpy()
    assert (drawn[:, known["sprint"]] == 1.0).all()


def test_a_person_s_clips_need_no_labels() -> None:
    """Regression: six clips without an index could not be personalised to."""
    found = Sentences([clip({}), clip({"content": "bow"})], embedded, personal=True)
    off, walks = np.zeros(3, np.bool_), np.array([True, False, False])
    rows = found.draw(np.random.default_rng(0), np.array([0, 0, 1]), off, walks)
    assert found.texts[rows[0]] in wordings("walk") and rows[1] == NONE and found.texts[rows[2]] in wordings("bow")
