"""`gesture_change`: what is under way with another gesture beside it, or with none: "wave as well", "stop waving"."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import replace

from flexmotion.sampling.beside import fits_beside
from flexmotion.streamer.motion.at_once import amount_of, without_amount
from flexmotion.streamer.motion.gesture_words import ends_gesture, says_only
from flexmotion.streamer.motion.heard import GOALS
from flexmotion.streamer.motion.measured_steps import NothingChangesError
from flexmotion.streamer.motion.programs import VELOCITY, Program, Step
from flexmotion.streamer.motion.speeds import Model
from flexmotion.text.clause import Asks, Clause
from flexmotion.text.ellipsis import with_side
from flexmotion.text.limbs import lowered_arm
from flexmotion.text.meanwhile import is_posture, meanwhile, says_at_once
from flexmotion.text.phrases import BOTH_UP, STAND, WALK, limbs
from flexmotion.text.sides import LEFT, RIGHT, sides
from flexmotion.text.vocabulary import vocabulary

_ALSO = re.compile(r"^(?:and |now )?also (?P<behind>.+)$|^(?P<before>.+?) (?:too|as well|also)$")
"""A request that comes to what is under way."""

_KEEPS = re.compile(r"(?:please )?(?:keep|keep on|continue|go on) (?P<rest>[\w ]+)")
"""A request that something goes on."""

Change = tuple[Step, str, tuple[str, ...]]
"""The step, a note, and parts of the request that are not done."""


def gesture_change(
    clauses: Sequence[Clause], under_way: Program | None, motion: Callable[[Clause], Step], model: Model
) -> Change | None:
    """The step under way, which goes on, with what a sentence asks of the gesture beside it; None: it asks for else.

    Args:
        clauses: of the sentence.
        under_way: what the robot does; None: it stands. Of several steps nothing is changed: which of them is done is
            not known here.
        motion: makes the step of a request; raises `RefusedError`.
        model: that hears words.

    Raises:
        NothingChangesError: an arm is to be lowered that the gesture does not raise alone.
        RefusedError: the gesture cannot be made.
    """
    if not clauses or under_way is None or len(under_way.steps) != 1 or any(one.refusal for one in clauses):
        return None
    if any(not says_at_once(phrase) for clause in clauses for phrase in clause.dropped):
        return None  # "keep waving as you halt"
    (step,) = under_way.steps
    if step.kind == STAND:
        return None
    kind, first = step.told.beside, clauses[0]
    if kind is not None:
        asked = [clause for clause in clauses if not ends_gesture(clause, kind, model)]
        if len(asked) < len(clauses) and all(_keeps(clause, _moving(step), model) for clause in asked):
            return step.with_beside(None), f"{step.kind} goes on without it", ()
        if len(clauses) == 1 and (_keeps(first, kind, model) or _keeps(first, _moving(step), model)):
            return step, "it goes on", ()
        if len(clauses) == 1 and (lowered := lowered_arm(first.text)) and "arm" in (limbs(kind) or ()):
            return _lowered(step, first, *lowered, motion)
        if len(clauses) == 1 and first.asks is Asks.AGAIN and first.side is not None and _is_of_limb(first):
            return _other_side(step, first, motion)
    return None if len(clauses) != 1 else _added(step, first, motion, model)


def _added(step: Step, clause: Clause, motion: Callable[[Clause], Step], model: Model) -> Change | None:
    """A gesture that comes to what is under way; None where the request does not say that it does."""
    also = _ALSO.match(clause.text)
    # "Hold out your right hand" comes to a walk, and takes the place of a bow.
    travels = step.kind in (VELOCITY, *GOALS) or step.turn != 0 or step.axis != (0, 0)
    comes = bool(clause.dropped) or also is not None or (travels and is_posture(clause.text))
    if clause.asks is not Asks.MOTION or clause.forbidden or clause.still or clause.beside is not None or not comes:
        return None
    text = clause.text if also is None else also["behind"] or also["before"]
    gesture = motion(without_amount(replace(clause, text=text)))
    only = says_only(meanwhile(text) or text, gesture.kind, model)
    if not (only and fits_beside(gesture.kind, _moving(step))):
        return None
    before = "" if step.told.beside in (None, gesture.kind) else f", without {step.told.beside}"
    dropped = () if clause.amount is None and not clause.counted else (amount_of(clause),)
    return step.with_beside(gesture), f"{step.kind} goes on{before}", dropped


def _lowered(step: Step, clause: Clause, side: str, arm: str, motion: Callable[[Clause], Step]) -> Change:
    """One arm comes down, and the other stays where the gesture has it."""
    kind = str(step.told.beside)
    if kind != BOTH_UP or side not in (LEFT, RIGHT):
        reason = f"{kind} does not raise the {side} {arm}" if sides(kind) else f"{kind} is no motion of one {arm} alone"
        raise NothingChangesError(f"{clause.said!r}: {reason}")
    other = replace(without_amount(clause), text=f"raise your {RIGHT if side == LEFT else LEFT} hand")
    return step.with_beside(motion(other)), f"{step.kind} goes on", ()


def _other_side(step: Step, clause: Clause, motion: Callable[[Clause], Step]) -> Change:
    """The gesture with the other hand: "now with the left hand"."""
    kind, gesture = str(step.told.beside), step.beside
    if len(sides(kind)) != 1 or gesture is None:
        raise NothingChangesError(f"{clause.said!r}: {kind} has no other side")
    side = clause.side if clause.side in (LEFT, RIGHT) else LEFT if RIGHT in sides(kind) else RIGHT
    text = with_side(gesture.text, str(side))
    other = replace(without_amount(clause), asks=Asks.MOTION, side=None, text=text, speed=gesture.tempo)
    return step.with_beside(motion(other)), f"{step.kind} goes on", ()


def _moving(step: Step) -> str:
    """Kind of motion of a step, that of a walk for a velocity and for a way to a heading or a place."""
    return WALK if step.kind in (VELOCITY, *GOALS) else step.kind


def _is_of_limb(clause: Clause) -> bool:
    return bool(vocabulary().words("limbs") & set(clause.said.split()))


def _keeps(clause: Clause, kind: str, model: Model) -> bool:
    """Whether a request asks a kind of motion to go on: "keep waving", "go on"."""
    if clause.amount is not None or clause.counted or clause.forbidden or clause.still or clause.beside is not None:
        return False
    if clause.asks is not Asks.MOTION:
        return clause.asks is Asks.CONTINUE
    kept = _KEEPS.fullmatch(clause.text)
    if kept is None:
        return False
    if set(kept["rest"].split()) <= vocabulary().words("going_on"):
        return kept["rest"] in ("going", "moving") or model.prompt(kept["rest"]).kind == kind
    return says_only(kept["rest"], kind, model)
