"""Words that mean a restriction and are none that a run takes: refused with the words that work, never done in part."""

from __future__ import annotations

import pytest

from flexmotion.text.phrases import kinds, wordings
from flexmotion.text.restriction_phrases import restriction_phrase
from flexmotion.text.restriction_refusals import restriction_refusal
from flexmotion.text.sayings import sayings


@pytest.mark.parametrize(
    ("sentence", "foot"),
    [
        ("keep your left foot dwn", "left"),  # walked to the left
        ("keep your lft foot down", "left"),  # stood, and kept nothing; as near to "lift"
        ("keep yuor left foot down", "left"),
        ("keep you left food down", "left"),
        ("keep your right leg where it is", "right"),
        ("keep the left foot in place", "left"),  # walked to the left
        ("dont lif your rigth foot", "right"),
        ("keep both of your feet on the grond", "both"),
    ],
)
def test_a_foot_in_other_words_is_refused_with_those_that_work(sentence: str, foot: str) -> None:
    reason = restriction_refusal(sentence)
    named = "both feet" if foot == "both" else f"your {foot} foot"
    assert restriction_phrase(sentence) is None
    assert reason is not None and reason.startswith(f"{sentence!r}: where a foot stays is a restriction")
    assert f"'keep {named} down'" in reason and f"--contact {foot}" in reason
    assert restriction_phrase(f"keep {named} down") is not None


@pytest.mark.parametrize(
    ("sentence", "option"),
    [
        ("keep your left foot down then walk two steps", "--contact left"),  # walked
        ("keep your left foot down and wave", "--contact left"),  # waved, and kept nothing
        ("walk forward but keep your left foot on the ground", "--contact left"),  # walked, and said so
        ("walk while your right foot stays planted", "--contact right"),
        ("wave without lifting your right foot", "--contact right"),
        ("keep both of your feet on the ground and wave", "--contact both"),
        ("you may lift your left foot again and wave", "--contact left"),
        ("wave with no more than 1 newton metre", "--torque knee 1"),
        ("loosen your arms and wave", "--tension"),  # waved with both hands
        ("walk and stiffen your arms", "--tension"),  # raised both hands
        ("make your arms softer", "--tension"),  # stretched them out to the sides
        ("lossen your arms", "--tension"),
    ],
)
def test_a_restriction_beside_something_else_is_never_dropped(sentence: str, option: str) -> None:
    reason = restriction_refusal(sentence)
    assert reason is not None and option in reason


@pytest.mark.parametrize(
    "sentence",
    ["no more than -2 newton metres at the elbow", "limit the knee to minus 2 Nm", "limit the knee to - 2 Nm"]
    + ["at most negative two newton metres at the knee", "no more than \N{MINUS SIGN}2 Nm at the elbow"],
)
def test_a_torque_below_nothing_is_no_cap(sentence: str) -> None:
    """The sign was not read: "no more than -2 newton metres at the elbow" capped it at 2 N·m."""
    reason = restriction_refusal(sentence)
    assert restriction_phrase(sentence) is None
    assert reason is not None and "to 0.01 N·m or more" in reason and "--torque knee 1" in reason


@pytest.mark.parametrize("sentence", ["no more than 0 N·m at the left elbow", "limit the left elbow to 0.001 Nm"])
def test_a_torque_of_nothing_is_no_cap(sentence: str) -> None:
    """It was accepted and capped the elbow at 0.01 N·m; the same number in a message was refused."""
    reason = restriction_refusal(sentence)
    assert restriction_phrase(sentence) is None
    assert reason is not None and "to 0.01 N·m or more" in reason


@pytest.mark.parametrize(
    "sentence",
    [
        "let your arms go",
        "relax your left arm",
        "release your arms",
        "let go of your arms",
        "don't stiffen your left arm",
    ],
)
def test_no_words_let_a_tension_go_and_the_refusal_names_the_message_that_does(sentence: str) -> None:
    """The robot stood for "let your arms go", its arms as stiff as before, and raised the left arm to relax it."""
    reason = restriction_refusal(sentence)
    assert reason is not None and "--relax 'tension both arms'" in reason


@pytest.mark.parametrize(
    "sentence", ["keep your left foot down", "no more than 1 newton metre at the knee", "loosen your arms"]
)
def test_a_restriction_that_no_run_took_is_sent_to_one(sentence: str) -> None:
    """Prompts and scripts heard a stand in it, or "a number without a unit that is known"."""
    reason = restriction_refusal(sentence)
    assert reason is not None and f"flexmotion send {sentence!r}" in reason and "a prompt or a script" in reason


@pytest.mark.parametrize(
    "sentence",
    [
        "keep your feet still and bow",
        "please don't move your feet, just raise your left arm",
        "kick with your left foot",
        "step left with your left foot",
        "walk with relaxed arms",
        "walk stiffly",
        "let your arms go up",
        "leave your left hand down",
        "keep walking to the left",
        "walk two feet ahead",
        "plant your feet and wait",
    ],
)
def test_motions_are_no_restrictions(sentence: str) -> None:
    assert restriction_refusal(sentence) is None


def test_nothing_that_a_model_is_taught_is_taken_for_a_restriction() -> None:
    taught = [sentence for _, sentence in sayings()] + [wording for kind in kinds() for wording in wordings(kind)]
    assert len(taught) > 1000
    assert [sentence for sentence in taught if restriction_refusal(sentence) is not None] == []
