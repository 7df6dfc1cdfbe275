"""`remark_on`: what an operator is told about an intent before it is followed."""

from __future__ import annotations

from flexmotion.streamer.motion.intents import Intent, Text
from flexmotion.streamer.motion.programs import Program
from flexmotion.streamer.motion.speeds import Model
from flexmotion.text.alarm import is_alarm
from flexmotion.text.phrases import STAND
from flexmotion.text.prompt_reader import SAME
from flexmotion.text.spelling import as_meant


def remark_on(model: Model, intent: Intent, program: Program) -> str | None:
    """Message about an intent: what words are taken for, a slower velocity; None: there is none."""
    heard = program.heard
    if (
        not isinstance(intent, Text)
        or not program.is_open
        or heard.state not in ("accepted", "slowed")
        or is_alarm(intent.text)
    ):
        return heard.told()
    # A sentence is taken for one kind of motion, which may not be the one that was meant.
    prompt = model.prompt(as_meant(intent.text, model.is_word)[0])
    # "Don't stop" is read as a prohibition, but the robot goes on.
    goes_on = prompt.warning is not None and program.steps[0].kind != STAND
    if prompt.warning is not None and not goes_on:
        return prompt.warning
    exact = heard.manner is None and not goes_on and (prompt.likeness >= SAME or intent.text == prompt.kind)
    found = [] if exact else [f"heard as {heard.heard_as}" + (f", {heard.manner}" if heard.manner else "")]
    found += [] if heard.slowed is None else [f"slowed to {heard.slowed}"]
    found += list(heard.notes)
    return f"{intent.text!r} is {' and '.join(found)}" if found else None
