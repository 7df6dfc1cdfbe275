"""Questions are told from requests in the form of a question."""

from __future__ import annotations

import pytest

from flexmotion.text.phrases import STAND
from flexmotion.text.questions import QUESTION, is_question
from flexmotion.text.rewording import reworded
from flexmotion.text.sayings import NOTHING, sayings


@pytest.mark.parametrize(
    "sentence",
    [
        "why did you turn left?",
        "how many steps did you walk?",
        "hey robot, are you walking?",
        "did you just wave?",
        "who told you to wave?",
    ],
)
def test_a_question_about_a_motion_asks_for_none(sentence: str) -> None:
    """The robot turned left when it was asked "why did you turn left?"."""
    assert is_question(sentence)


@pytest.mark.parametrize(
    "sentence",
    ["can you wave?", "are you able to bow?", "would you turn left?", "do you mind waving?", "do the robot", "do it"],
)
def test_a_request_in_the_form_of_a_question_is_none(sentence: str) -> None:
    assert not is_question(sentence)


def test_no_taught_request_is_taken_for_a_question() -> None:
    taken = [(kind, said) for kind, said in sayings() if kind not in (NOTHING, STAND) and is_question(reworded(said))]
    assert taken == [], QUESTION
