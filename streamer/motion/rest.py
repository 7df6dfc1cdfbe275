"""`asks_for_rest`: targets that every run follows, whatever its source can follow: they bring the robot to a stand."""

from __future__ import annotations

from flexmotion.streamer.motion.heard import Heard
from flexmotion.streamer.motion.intents import Intent, Stop, Text, Velocity, words_of
from flexmotion.text.phrases import STAND
from flexmotion.text.standing import asks_to_stand


def asks_for_rest(intent: Intent) -> bool:
    """Whether an intent asks for nothing but a stand."""
    match intent:
        case Stop() | Velocity(0.0, 0.0, 0.0):
            return True
        case Text(text):
            return asks_to_stand(text)
    return False


def heard_as_rest(intent: Intent, *notes: str) -> Heard:
    """The answer to such an intent; `notes`: how the run goes on after it."""
    return Heard(asked=words_of(intent), state="accepted", heard_as=STAND, notes=notes)
