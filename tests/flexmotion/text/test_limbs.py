"""Limbs that a sentence names for a motion."""

from __future__ import annotations

import pytest

from benchmarks.model.hearing import GESTURES, untaught_sentences
from flexmotion.text.limbs import limb_refusal, unused_limb
from flexmotion.text.phrases import kinds, limbs, wordings
from flexmotion.text.sayings import sayings
from flexmotion.text.vocabulary import vocabulary


@pytest.mark.parametrize(
    ("sentence", "kind", "limb"),
    [
        # "wave with your left foot" waved the left hand, "kick with your hand" kicked, without a word about it.
        ("wave with your left foot", "wave-left-hand", "foot"),
        ("kick with your hand", "kick", "hand"),
        ("wave your foot", "wave-right-hand", "foot"),
        ("left foot wave", "wave-left-hand", "foot"),
        ("clap your feet", "clap", "feet"),
        ("nod using both hands", "nod", "hands"),
        ("a wave of the foot", "wave-right-hand", "foot"),
        ("wave by moving your foot", "wave-right-hand", "foot"),
        ("Wave with one hand and one foot!", "wave-right-hand", "foot"),
        ("run with your hands", "run", "hands"),
    ],
)
def test_a_limb_that_a_motion_does_not_use_is_named(sentence: str, kind: str, limb: str) -> None:
    assert unused_limb(sentence, kind) == limb
    refusal = limb_refusal(sentence, kind)
    assert refusal is not None and refusal.endswith(f"not of the {limb}")


@pytest.mark.parametrize(
    ("sentence", "kind"),
    [
        ("kick with your left foot", "kick"),
        ("wave with your hand over your head", "wave-right-hand"),
        ("look at your feet", "look-down"),
        ("check the floor in front of your feet", "look-down"),
        ("walk with your arms folded", "walk"),
        ("bow with one hand on your stomach", "bow"),
        ("walk and swing your arms", "walk"),
        ("walk swinging your arms", "walk"),
        ("walk two feet ahead", "walk"),
        ("wave at the foot of the bed", "wave-right-hand"),
        ("kick my hand", "kick"),
        ("head to the right", "walk-turn-right"),
        ("dance with your hands", "dance-short"),
        ("shuffle with your hands", "a kind of somebody's own"),
    ],
)
def test_places_postures_and_other_peoples_limbs_are_not_what_a_motion_is_made_with(sentence: str, kind: str) -> None:
    assert unused_limb(sentence, kind) is None


def test_no_known_sentence_names_a_limb_that_its_motion_does_not_use() -> None:
    said = [(kind, wording) for kind in kinds() for wording in wordings(kind)]
    said += [(kind, sentence) for kind, sentence in sayings()]
    for sentences in (untaught_sentences(), untaught_sentences(GESTURES)):
        said += [(kind, sentence) for kind, own in sentences.items() for sentence in own]
    assert len(said) > 1000
    assert [(kind, sentence) for kind, sentence in said if unused_limb(sentence, kind)] == []


def test_the_limbs_of_every_kind_are_groups_of_the_grammar() -> None:
    groups = set(vocabulary().table["limb_groups"])
    assert all((limbs(kind) or groups) <= groups for kind in kinds())
    # YAML reads a bare "on" as true.
    lists = [vocabulary().table[f"limb_{name}"] for name in ("owners", "means", "places", "postures", "regions")]
    assert all(isinstance(word, str) for words in lists for word in words)


@pytest.mark.parametrize(
    ("sentence", "kind", "one"),
    [
        ("stretch out your right arm", "arms-to-the-sides", "right arm"),
        ("put your left hand on your hip", "hands-on-hips", "left hand"),
        ("stretch out your left arm and your right arm", "arms-to-the-sides", None),
        ("stretch out both arms", "arms-to-the-sides", None),
        ("raise your right arm", "raise-up-right-hand", None),
    ],
)
def test_one_arm_is_no_motion_of_both(sentence: str, kind: str, one: str | None) -> None:
    """The right arm that was to be stretched out took the left one with it, without a word."""
    refusal = limb_refusal(sentence, kind)
    assert refusal is None if one is None else refusal is not None and repr(one) in refusal
