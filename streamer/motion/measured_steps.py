"""`measured`: a step with an end that is measured, within what its motion and the robot can do."""

from __future__ import annotations

from dataclasses import replace

from flexmotion.sampling.pace import Pace
from flexmotion.sampling.request import STILL
from flexmotion.sampling.sampler import Condition
from flexmotion.streamer.motion.intents import FASTEST, Velocity
from flexmotion.streamer.motion.programs import LEAST, MOST, Step, limit_s
from flexmotion.streamer.motion.speeds import Model, Speeds
from flexmotion.text.amounts import Amount
from flexmotion.text.paces import Rate
from flexmotion.text.phrases import STAND
from flexmotion.text.vocabulary import Quantity

TURNING = 0.5
"""Speed of turns that are measured, within the robot's pace [rad/s]."""


class RefusedError(Exception):
    """A request that cannot be done, with the reason."""


class NothingChangesError(RefusedError):
    """One that asks for nothing that the robot could do now, and lets it go on with what it does."""


def fits(step: Step) -> tuple[Quantity, ...]:
    """Quantities in which a motion is measured."""
    if step.turn:
        return ("angle", "time", "steps")
    if step.axis != (0, 0) or step.kind == "velocity":
        return ("length", "time", "steps")
    return ("time",) if step.kind == STAND else ("time", "times")


def at_rate(speeds: Speeds, step: Step, rate: Rate, on_the_spot: bool) -> Step:
    """The step at a speed with a unit: that of its human, as of a velocity.

    Args:
        on_the_spot: whether a turn is one; else it goes ahead as its words do, by the same factor.

    Raises:
        RefusedError: its motion has no such speed, or it is out of bounds.
    """
    way = "turn" if step.turn else "walk" if step.axis != (0, 0) else None
    if way is None or rate.turns != (way == "turn"):
        known = {"turn": "a speed in degrees or radians a second", "walk": "a speed in metres a second"}
        raise RefusedError(f"{rate.said!r}: {step.kind} has {known.get(way or '', 'no speed with a unit')}")
    along = (0.0, 0.0, float(step.turn)) if step.turn else (float(step.axis[0]), float(step.axis[1]), 0.0)
    own = speeds.model.own_velocity(speeds.model.meant(Condition(step.told.text)))
    if step.turn and not on_the_spot and own is not None and own[2] * step.turn > 0.0:
        along = (own[0] / abs(own[2]), own[1] / abs(own[2]), float(step.turn))
    fastest = min(most / abs(share) for most, share in zip(FASTEST, along, strict=True) if share)
    if not STILL <= rate.value <= fastest:
        unit = "rad/s" if rate.turns else "m/s"
        raise RefusedError(f"{rate.said!r} is {rate.value:.3g} {unit}, expected {STILL:g} to {fastest:.3g} {unit}")
    forward, left, turning = (share * rate.value for share in along)
    slowed = speeds.slowed(Condition(velocity=(forward, left, turning), pace=speeds.pace))
    told = step.told.model_copy(update={"slowed": slowed})
    return replace(step, intent=Velocity(forward, left, turning, step.told.manner, beside=step.beside), told=told)


def on_the_spot(pace: Pace | None, step: Step) -> Step:
    """A turn that does not walk ahead, at the robot's pace, or slower where its words are.

    Args:
        pace: greatest speed of the human; None: no limit.
    """
    fastest = TURNING if pace is None else min(TURNING, pace.turning)
    asked = abs(step.intent.turning) if isinstance(step.intent, Velocity) else 0.0
    rate = min(asked or fastest, fastest)
    told = step.told.model_copy(update={"slowed": None})
    return replace(step, intent=Velocity(0.0, 0.0, step.turn * rate, step.told.manner, beside=step.beside), told=told)


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
        step = on_the_spot(pace, step)
    limit = limit_s(step, amount)
    told = step.told.model_copy(update={"amount": round(amount.value, 6), "unit": amount.quantity, "limit_s": limit})
    return replace(step, amount=amount, limit_s=limit, told=told)


def _unit_text(quantity: Quantity) -> str:
    return {"angle": "degrees", "length": "metres", "time": "seconds"}.get(quantity, quantity)
