"""`Program`: the steps of a sentence, each with a motion, an amount and a time limit."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import pi

import numpy as np

from flexmotion.sampling.request import is_still
from flexmotion.sampling.rhythm import Rhythm
from flexmotion.streamer.motion.heard import Heard, HeardStep
from flexmotion.streamer.motion.intents import Goal, Intent, Text, Velocity, gesture_of
from flexmotion.text.amounts import Amount
from flexmotion.text.phrases import STAND
from flexmotion.text.vocabulary import Quantity

MOST: dict[Quantity, float] = {"angle": 4 * pi, "length": 10.0, "steps": 40.0, "time": 120.0, "times": 10.0}
"""Greatest amount of one request: two whole turns [rad], [m], steps, [s], times."""

LEAST: dict[Quantity, float] = {"angle": np.radians(5.0), "length": 0.02, "steps": 1.0, "time": 0.1, "times": 1.0}
"""Smallest amount that the robot can measure and do."""

MOST_STEPS = 12
"""Requests in one sentence."""

WALK_S, STAND_S, TURN_RAD = 4.0, 2.0, pi / 2
"""Amounts of a walk, of a wait and of a turn in a sequence that says none."""

NOT_SAID = "no amount said"
"""Words of an amount that the sentence did not say."""

VELOCITY = "velocity"
"""Kind of motion of a velocity that was sent as one."""

GESTURE_S = 3.5
"""Time of one wave, one bow and so on: a window of the model before it and after it, and the motion [s]."""


@dataclass(frozen=True)
class Step:
    """One request, ready to be followed.

    Attributes:
        intent: what the model is asked.
        kind: of motion.
        amount: how much, measured at the robot; None: until something else is asked.
        axis: direction of a walk, ahead and left; (0, 0) for other motions.
        turn: side of a turn: 1 left, -1 right, 0 for other motions.
        limit_s: the step ends after this time at the latest [s].
        told: for the answer.
        goal: heading or place in the odometry, at which the step ends; None: none.
        rhythm: its repeated strokes, by which its repetitions are counted; None: they are seen at the robot.
    """

    intent: Intent
    kind: str
    amount: Amount | None
    axis: tuple[int, int]
    turn: int
    limit_s: float | None
    told: HeardStep
    goal: Goal | None = None
    rhythm: Rhythm | None = None

    @property
    def stands(self) -> bool:
        """Whether it is to stand."""
        return self.kind == STAND and self.goal is None

    @property
    def is_still(self) -> bool:
        """Whether it is a velocity that means standing."""
        match self.intent:
            case Velocity(forward, left, turning):
                return self.goal is None and is_still((forward, left, turning))
        return False

    @property
    def is_led(self) -> bool:
        """Whether the odometry leads the human, who stands until then: to a goal, or through a measured turn."""
        turns = self.amount is not None and self.amount.quantity == "angle" and isinstance(self.intent, Velocity)
        return self.goal is not None or turns

    @property
    def beside(self) -> Text | None:
        """The gesture that is made meanwhile; None: there is none."""
        return gesture_of(self.intent)

    def with_beside(self, gesture: Step | None) -> Step:
        """The step with a gesture that is made meanwhile, as long as the step lasts; None: without one."""
        if gesture is None:
            return self._beside(None, None)
        assert isinstance(gesture.intent, Text)
        return self._beside(gesture.intent, gesture.kind)

    def with_beside_of(self, other: Step) -> Step:
        """The step with the gesture that is made beside another one, if there is one."""
        return self._beside(other.beside, other.told.beside)

    def _beside(self, gesture: Text | None, kind: str | None) -> Step:
        assert isinstance(self.intent, Text | Velocity)
        told = self.told.model_copy(update={"beside": kind})
        return replace(self, intent=replace(self.intent, beside=gesture), told=told)

    @property
    def begins(self) -> Intent:
        """What the human does as the step begins."""
        return Text("stand still", beside=self.beside) if self.is_led else self.intent

    @property
    def moves(self) -> bool:
        """Whether it moves the robot from its place, or turns it."""
        still = isinstance(self.intent, Velocity) and not any(
            (self.intent.forward, self.intent.left, self.intent.turning)
        )
        velocity = self.kind == VELOCITY and not still
        return self.turn != 0 or self.axis != (0, 0) or velocity or self.goal is not None


@dataclass(frozen=True)
class Program:
    """Steps in their order. After the last one the robot stands, unless it has no amount.

    Attributes:
        number: identifies the program; a change of speed keeps it.
        heard: the answer.
    """

    steps: tuple[Step, ...]
    heard: Heard
    number: int = 0

    @property
    def is_open(self) -> bool:
        """Whether it is one motion without an end, which nothing has to measure."""
        first = self.steps[0]
        return len(self.steps) == 1 and first.amount is None and first.goal is None

    @property
    def limit_s(self) -> float | None:
        """The longest time that it takes [s]; None: without an end."""
        limits = [step.limit_s for step in self.steps]
        return None if None in limits else sum(limit for limit in limits if limit is not None)


def usual_amount(step: Step, times: int) -> Amount:
    """What a request without an amount means in a sequence."""
    if step.turn:
        return Amount(TURN_RAD * times, "angle", NOT_SAID)
    if step.axis != (0, 0):
        return Amount(WALK_S * times, "time", NOT_SAID)
    if step.kind == STAND:
        return Amount(STAND_S * times, "time", NOT_SAID)
    return Amount(float(times * (1 if step.rhythm is None else step.rhythm.usual)), "times", NOT_SAID)


def limit_s(step: Step, amount: Amount) -> float:
    """The longest time that a step is given: about twice what the slowest robot's pace takes [s]."""
    value = amount.value
    match amount.quantity:
        case "angle":
            return 12.0 + value / 0.2
        case "length":
            return 10.0 + value * (60.0 if step.axis[1] else 20.0)
        case "steps":
            return 8.0 + 2.0 * value
        case "times" if step.rhythm is not None:
            return 4.0 + step.rhythm.seconds(int(value))
        case "times":
            return 4.0 + (GESTURE_S + 4.0) * value
    return value + 2.0
