"""Manners: which words say one, which manner they mean, and what becomes of those that a model does not offer."""

from __future__ import annotations

import numpy as np
import pytest

from flexmotion.text import manners
from flexmotion.text.listener import Listener
from flexmotion.text.manner_phrases import manner_phrases, without_phrases
from flexmotion.text.manner_reader import MannerReader
from flexmotion.text.sayings import NOTHING
from flexmotion.text.word_pieces import WordPieces


class Encoder:
    """Embeds a sentence by its length."""

    pieces = WordPieces(["[UNK]", "grandpa", "like"])

    def __call__(self, sentence: str) -> np.ndarray:
        return np.array([1.0, 0.0], np.float32)


def listener(kind: str) -> Listener:
    """A listener that hears the piece `grandpa` as a manner, and all else as none."""
    weights = np.zeros((2 + 1 + 1, 2), np.float32)
    weights[2, 0], weights[3, 1] = 9.0, 3.0
    return Listener([kind, NOTHING], np.array([1], np.int32), weights)


def test_every_manner_has_wordings_of_its_own() -> None:
    assert manners.manners()[0] == manners.NORMAL
    said = [phrase for name in manners.manners() for phrase in manners.manner_wordings(name)]
    said += [phrase for name in manners.manners() for phrase in manners.manner_sayings(name)]
    assert len(set(said)) == len(said)
    assert all(len(manners.manner_wordings(name)) >= 5 for name in manners.manners())
    assert not set(said) & (set(manners.unknown_manners()) | manners.neutral_words())


def test_every_style_of_the_clips_is_a_manner() -> None:
    styles = (
        "active normal feminine youthful masculine exhausted elderly childish giant tired happy masculinity musical"
    )
    styles += " not-confident sad chimpira old proud angry"
    assert all(manners.manner_of_style(style) in manners.manners() for style in styles.split())
    assert manners.manner_of_style("of no table") is None


@pytest.mark.parametrize(
    ("sentence", "said"),
    [
        ("walk like an old man", [("like an old man", "old")]),
        ("Wave proudly, please", [("proudly", "proud")]),
        ("sneak along the wall", [("sneak", "sneak")]),
        ("walk as if you were drunk, then stop", [("as if you were drunk", "drunk")]),
        ("an old man walks", [("old man", "old")]),
        ("walk in a french manner and wave", [("in a french manner", None)]),
        ("a sad walk without a sound", [("sad", "sad"), ("without a sound", "sneak")]),
        # Words that ask for no manner.
        ("I'd like you to step forward", []),
        ("bow politely to an old lady", []),
        ("walk slowly and calmly", []),
        ("that looks like rain", []),
        ("wave with the right hand", []),
    ],
)
def test_phrases_that_say_a_manner(sentence: str, said: list[tuple[str, str | None]]) -> None:
    assert [(phrase.text, phrase.manner) for phrase in manner_phrases(sentence)] == said


def test_a_sentence_without_its_manner() -> None:
    sentence = "Wave proudly like a king with the right hand"
    assert without_phrases(sentence, manner_phrases(sentence)) == "Wave with the right hand"


def test_what_the_model_does_not_offer_is_dropped_and_named() -> None:
    """Regression: "walk like an old man" was walked normally, and nothing said so."""
    heard = MannerReader(Encoder(), (), None)("walk proudly like an old man")
    assert heard.manner == manners.NORMAL and heard.dropped == ("proudly", "like an old man")
    heard = MannerReader(Encoder(), ("normal", "old"), None)("walk proudly like an old man")
    assert heard.manner == "old" and heard.dropped == ("proudly",)


def test_unlisted_words_are_classified_and_unknown_ones_dropped() -> None:
    read = MannerReader(Encoder(), ("normal", "old"), listener("old"))
    assert read("walk like our grandpa").manner == "old" and not read("walk like our grandpa").dropped
    unknown = read("walk like a lighthouse")
    assert unknown.manner == manners.NORMAL and unknown.dropped == ("like a lighthouse",)
    assert read("walk on").phrases == ()


def test_a_personal_manner_is_known_by_its_own_words() -> None:
    heard = MannerReader(Encoder(), ("normal", "like Ada"), None)("Walk like ADA to the left")
    assert heard.manner == "like Ada" and not heard.dropped


def test_of_two_persons_the_longer_name_is_meant() -> None:
    """Each name was looked for by itself: "like Ada Lovelace" was done like Ada."""
    read = MannerReader(Encoder(), ("normal", "like Ada", "like Ada Lovelace"), None)
    assert read("wave like ada lovelace").manner == "like Ada Lovelace"
    assert read("wave like Ada").manner == "like Ada" and not read("wave like Ada").dropped
    assert read("wave like Adam").manner == manners.NORMAL
    both = read("walk like Ada, then wave like Ada Lovelace")
    assert both.manner == "like Ada" and both.dropped == ("like ada lovelace",)
