"""Which sentences ask for a stand where no model listens."""

from __future__ import annotations

import pytest

from flexmotion.text.standing import asked_stand


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
        "stop and stand still",
        "ok, stop, stand still",
        "hold your position",
        "hold on",
        "whoa",
        "I told you to stop",
        "you can stop now",
        "why don't you stop",
        "that's enough",
        "that’s enough!",
        "enough",
        "quit mirroring",
        "finish the dance",
        "don't mirror me",
        "don't walk at 2 m/s",
        "no",
        "no, wait",
        "come to a stand",
        "stop mirroring and stand still",
    ],
)
def test_a_stand_is_understood_without_a_model(sentence: str) -> None:
    """Went wrong: a run that plays a clip or mirrors refused most words for a stop, and the robot moved on."""
    assert asked_stand(sentence) is not None


@pytest.mark.parametrize(
    "sentence",
    [
        "mirror",
        "walk",
        "don't stop",
        "never stop",
        "lower your right hand",
        "wave",
        "?",
        "mirror me",
        "please do not stop mirroring",
        "do not stop, wave",
        "don't freeze",
        "I don't want you to stop",
        "walk forward without stopping",
        "wave like a stop sign",
        "walk, no hurry",
        "hold your hand up",
        "raise your arms and keep them up",
        "keep going",
        "faster",
    ],
)
def test_other_sentences_are_none(sentence: str) -> None:
    assert asked_stand(sentence) is None


@pytest.mark.parametrize(
    ("sentence", "dropped"),
    [
        ("stop and wave", ("wave",)),
        ("walk then stop", ("walk",)),
        ("stop mirroring me and walk", ("walk",)),
        ("don't mirror me, walk", ("walk",)),
        ("stop, don't wave", ()),
    ],
)
def test_what_is_asked_for_beside_a_stand_is_told_as_left_out(sentence: str, dropped: tuple[str, ...]) -> None:
    """Went wrong: a stop beside another request was refused with it, and the robot moved on."""
    stand = asked_stand(sentence)
    assert stand is not None and stand.dropped == dropped


def test_words_that_switch_nothing_off_say_so() -> None:
    """Went wrong: "power off" was refused, and the robot moved on."""
    stand = asked_stand("power off")
    assert stand is not None and stand.notes == ("taken as a stand: torque stays on, no words switch it off",)
