"""How much of a step's amount the robot has done, when that is enough, and what is missing once it stands."""

from __future__ import annotations

import math

import numpy as np

from flexmotion.streamer.motion.programs import Step
from flexmotion.streamer.planning.robot_size import RobotSize
from flexmotion.streamer.planning.step_progress import StepProgress

_TURN_TOLERANCE, _WAY_TOLERANCE = np.radians(12.0), 0.12
"""What is missing of a turn [rad], or of a way (share of it), is done in another attempt."""


def done_of(at: StepProgress, step: Step, elapsed_s: float) -> float:
    """What is done of the amount, in its unit; `elapsed_s`: since the step began [s]."""
    assert step.amount is not None
    match step.amount.quantity:
        case "angle":
            return at.turned * (step.turn or 1)
        case "length":
            if step.axis == (0, 0):
                return math.hypot(at.ahead, at.aside)
            return at.ahead * step.axis[0] + at.aside * step.axis[1]
        case "steps":
            return float(at.steps(step))
        case "times" if step.rhythm is not None:
            return float(step.rhythm.times(at.played_s))
        case "times":
            return float(at.repetitions.done)
    return elapsed_s


def is_reached(at: StepProgress, step: Step, value: float) -> bool:
    """Whether the robot will have done the amount if it stops now; `value`: as of `done_of`."""
    assert step.amount is not None
    missing = step.amount.value - value
    if step.amount.quantity == "steps":
        return missing <= 0.0
    return at.closing.reached(-missing if at.acted_from > step.amount.value else missing)


def is_missing(step: Step, missing: float, size: RobotSize) -> bool:
    """Whether so much is missing, in the amount's unit, that another attempt is worth it."""
    assert step.amount is not None
    match step.amount.quantity:
        case "angle":
            return abs(missing) > _TURN_TOLERANCE
        case "length":
            return missing > max(_WAY_TOLERANCE * step.amount.value, size.least_way)  # walks do not go back
    # A step that was settled before the amount was reached is made.
    return not -1.5 < missing < 0.5
