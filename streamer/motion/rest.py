"""`asks_for_rest`: targets that every run follows, whatever its source can follow: they bring the robot to a stand."""

from __future__ import annotations

from flexmotion.streamer.motion.heard import Heard, State
from flexmotion.streamer.motion.intents import Intent, Stop, Text, Velocity, words_of
from flexmotion.text.phrases import STAND
from flexmotion.text.standing import asked_stand


def asks_for_rest(intent: Intent) -> bool:
    """Whether an intent asks for a stand, whatever else its words ask for."""
    match intent:
        case Stop() | Velocity(0.0, 0.0, 0.0):
            return True
        case Text(text):
            return asked_stand(text) is not None
    return False


def heard_as_rest(intent: Intent, *notes: str) -> Heard:
    """The answer to such an intent, with what else it asks for as dropped; `notes`: how the run goes on after it."""
    stand = asked_stand(intent.text) if isinstance(intent, Text) else None
    dropped, told = ((), ()) if stand is None else (stand.dropped, stand.notes)
    state: State = "partly" if dropped else "accepted"
    return Heard(asked=words_of(intent), state=state, heard_as=STAND, dropped=dropped, notes=(*told, *notes))
