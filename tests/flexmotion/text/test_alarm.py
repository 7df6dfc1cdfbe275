"""Words of alarm."""

from __future__ import annotations

import pytest

from benchmarks.model.hearing import untaught_sentences
from flexmotion.text.alarm import is_alarm
from flexmotion.text.phrases import STAND, kinds, wordings


@pytest.mark.parametrize(
    "sentence",
    [
        *("emergency stop", "Emergency stop!", "e-stop", "E-STOP", "estop", "halt", "Halt!", "abort", "emergency"),
        "abort abort",  # was refused as not understood
        *(
            "stop!",
            "STOP",
            "stop stop stop",
            "stop now",
            "stop it!!",
            "no, stop!",
            "please stop immediately",
            "help! stop",
        ),
        *("press the emergency stop", "stop everything", "oh no stop!", "STOP THE ROBOT", "stop, stop"),
    ],
)
def test_words_of_alarm_are_known(sentence: str) -> None:
    assert is_alarm(sentence)


@pytest.mark.parametrize(
    "sentence",
    [
        *("stop", "stop moving", "don't stop!", "do not stop", "stop waving!", "walk, then stop!", "signal stop!", ""),
        *("no emergency", "make a stop sign!", "stop after two steps!", "never stop!", "stay", "freeze", "no", "!"),
    ],
)
def test_other_words_are_left_to_the_grammar(sentence: str) -> None:
    assert not is_alarm(sentence)


def test_no_motion_is_taken_for_an_alarm() -> None:
    said = [(kind, wording) for kind in kinds() for wording in wordings(kind)]
    said += [(kind, sentence) for kind, own in untaught_sentences().items() for sentence in own]
    assert [one for one in said if is_alarm(one[1]) and one[0] not in (STAND, "nothing")] == []
