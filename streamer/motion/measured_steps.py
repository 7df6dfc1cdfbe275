"""`measured`: a step with an end that is measured, within what its motion and the robot can do."""

from __future__ import annotations

from dataclasses import replace

from flexmotion.sampling.pace import Pace
from flexmotion.streamer.motion.intents import Velocity
from flexmotion.streamer.motion.programs import LEAST, MOST, Step, limit_s
from flexmotion.streamer.motion.speeds import Model
from flexmotion.text.amounts import Amount
from flexmotion.text.phrases import STAND
from flexmotion.text.vocabulary import Quantity

TURNING = 0.5
"""Speed of turns that are measured, within the robot's pace [rad/s]."""


class RefusedError(Exception):
    """A request that cannot be done, with the reason."""


def fits(step: Step) -> tuple[Quantity, ...]:
    """Quantities in which a motion is measured."""
    if step.turn:
        return ("angle", "time", "steps")
    if step.axis != (0, 0) or step.kind == "velocity":
        return ("length", "time", "steps")
    return ("time",) if step.kind == STAND else ("time", "times")


def measured(model: Model, pace: Pace | None, step: Step, amount: Amount, times: int) -> Step:
    """The step with an end.

    Args:
        model: that follows it.
        pace: greatest speed of the human; None: no limit.
        times: how often the amount is done.

    Raises:
        RefusedError: its motion has no such amount, or it is out of bounds.
    """
    known = fits(step)
    if amount.quantity not in known:
        raise RefusedError(f"{amount.said!r}: {step.kind} is measured in {' or '.join(map(_unit_text, known))}")
    value = amount.value * (times if amount.quantity != "times" else 1)
    amount = replace(amount, value=value)
    least, most = LEAST[amount.quantity], MOST[amount.quantity]
    if not least <= value <= most:
        bounds = [str(replace(amount, value=bound)) for bound in (least, most)]
        raise RefusedError(f"{amount.said!r} is {amount}, expected {bounds[0]} to {bounds[1]}")
    if step.turn and amount.quantity == "angle" and model.follows_velocity:
        fastest = TURNING if pace is None else min(TURNING, pace.turning)
        asked = abs(step.intent.turning) if isinstance(step.intent, Velocity) else 0.0
        rate = min(asked or fastest, fastest)
        told = step.told.model_copy(update={"slowed": None})  # it turns on the spot, at the robot's pace
        step = replace(step, intent=Velocity(0.0, 0.0, step.turn * rate, step.told.manner), told=told)
    limit = limit_s(step, amount)
    told = step.told.model_copy(update={"amount": round(amount.value, 6), "unit": amount.quantity, "limit_s": limit})
    return replace(step, amount=amount, limit_s=limit, told=told)


def _unit_text(quantity: Quantity) -> str:
    return {"angle": "degrees", "length": "metres", "time": "seconds"}.get(quantity, quantity)
