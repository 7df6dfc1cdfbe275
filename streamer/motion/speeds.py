"""`Speeds`: how fast the human of a request moves, what it is slowed to, and "faster" and "slower"."""

from __future__ import annotations

from dataclasses import replace
from typing import Protocol

import numpy as np

from flexmotion.sampling.pace import Pace
from flexmotion.sampling.request import is_still
from flexmotion.sampling.rhythm import Rhythm
from flexmotion.sampling.sampler import Condition
from flexmotion.streamer.motion.intents import FASTEST, Text, Velocity
from flexmotion.streamer.motion.programs import Step, limit_s
from flexmotion.text.prompt_reader import Prompt

LEAST_CHANGE = 0.03
"""Least relative change of a speed that counts as one."""


class Model(Protocol):
    """What hearing needs of `flexmotion.sampling.sampler.Sampler`."""

    @property
    def follows_velocity(self) -> bool:
        """Whether a velocity can be requested."""
        ...

    def prompt(self, text: str) -> Prompt:
        """Meaning of a text."""
        ...

    def is_word(self, word: str) -> bool:
        """Whether a word in lower case is one of its language."""
        ...

    def meant(self, condition: Condition) -> Condition:
        """The condition with the velocity that its words mean, within its pace."""
        ...

    def own_velocity(self, condition: Condition) -> tuple[float, float, float] | None:
        """Velocity at which a meant condition is done; None where its words are of an unknown speed."""
        ...

    def rhythm(self, condition: Condition, size: int = 0) -> Rhythm | None:
        """The gesture of repeated strokes that a condition's words mean; None: they mean no such one."""
        ...


class Speeds:
    """Speeds of a model's human, for one robot.

    Args:
        model: that follows them.
        pace: greatest speed of the human; None: no limit.
    """

    def __init__(self, model: Model, pace: Pace | None) -> None:
        self.model, self.pace = model, pace

    def slowed(self, condition: Condition) -> str | None:
        """The speed to which a request is slowed, in words; None: it is not."""
        limited = self.model.meant(condition)
        found, meant = limited.velocity, self.model.meant(replace(condition, pace=None)).velocity
        if found is None or (meant is not None and velocity_text(found) == velocity_text(meant)):
            return None
        return f"a human's {velocity_text(found)}, so that the robot can follow"

    def changed(self, step: Step, factor: float) -> Step:
        """The step at another speed, within the limits; the same step where it has only one or is at a limit.

        The speed that the robot shows is changed. It does not change where only the human would go faster.
        """
        if step.rhythm is not None and isinstance(step.intent, Text):
            return self._paced(step, step.rhythm.speed * factor)
        base = self._velocity(step)
        if base is None:
            return step
        manner, base = self._manner(step), self._shown(base)
        scaled = _clipped(base, factor)
        if factor < 1.0 and is_still(scaled):
            return step
        limited = Condition(velocity=scaled, pace=self.pace)
        velocity = self._shown(self.model.meant(limited).velocity or base)
        change = float(np.abs(velocity).max() / max(np.abs(base).max(), 1e-9))
        if factor > 1.0 and change < 1.0 + LEAST_CHANGE:
            return step
        limit = None if step.limit_s is None else step.limit_s / min(change, 1.0)
        told = step.told.model_copy(update={"limit_s": limit})
        forward, left, turning = map(float, velocity)
        intent = Velocity(forward, left, turning, manner, beside=step.beside)
        return replace(step, intent=intent, limit_s=limit, told=told)

    def _paced(self, step: Step, tempo: float) -> Step:
        """A rhythm at another speed; the same step where it goes no further."""
        assert step.rhythm is not None and isinstance(step.intent, Text)
        rhythm = self.model.rhythm(Condition(step.intent.text, tempo=tempo))
        if rhythm is None or abs(rhythm.speed / step.rhythm.speed - 1.0) < LEAST_CHANGE:
            return step
        changed = replace(step, intent=replace(step.intent, tempo=rhythm.speed), rhythm=rhythm)
        if step.amount is None or step.amount.quantity != "times":
            return changed
        limit = limit_s(changed, step.amount)
        return replace(changed, limit_s=limit, told=step.told.model_copy(update={"limit_s": limit}))

    def _manner(self, step: Step) -> str | None:
        """Manner of a step's motion; None for the normal one."""
        return step.intent.manner if isinstance(step.intent, Velocity) else step.told.manner

    def _velocity(self, step: Step) -> tuple[float, float, float] | None:
        """Velocity of a step's human, of words within the pace as well; None where it has none."""
        asked = self._asked(step)
        if asked is None or not self.model.follows_velocity:
            return None
        own = self.model.own_velocity(self.model.meant(asked))
        return own if own is not None and any(own) else None

    def _asked(self, step: Step) -> Condition | None:
        """What a step asks of the model; None where it is neither words nor a velocity."""
        match step.intent:
            case Velocity(forward, left, turning):
                return Condition(velocity=(forward, left, turning), pace=self.pace)
            case Text(text):
                return Condition(text, pace=self.pace)
        return None

    def _shown(self, velocity: tuple[float, float, float]) -> tuple[float, float, float]:
        return velocity if self.pace is None else self.pace.shown(velocity)


def _clipped(velocity: tuple[float, float, float], factor: float) -> tuple[float, float, float]:
    scaled = np.clip(np.multiply(velocity, factor), np.negative(FASTEST), FASTEST)
    return float(scaled[0]), float(scaled[1]), float(scaled[2])


def velocity_text(velocity: tuple[float, float, float]) -> str:
    """A human's velocity in words; components that are zero are left out."""
    forward, left, turning = velocity
    parts = (
        (forward, "m/s ahead" if forward > 0 else "m/s back"),
        (left, f"m/s to the {_side(left)}"),
        (turning, f"rad/s turning {_side(turning)}"),
    )
    return " and ".join(f"{abs(value):.2g} {what}" for value, what in parts if value)


def _side(value: float) -> str:
    return "left" if value > 0 else "right"
