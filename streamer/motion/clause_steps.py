"""`ClauseSteps`: the steps of one request of a sentence: what the listener hears in it, how much, and how fast.

`Hearing` puts them together to a program.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from flexmotion.sampling.pace import Pace
from flexmotion.sampling.sampler import Condition
from flexmotion.streamer.motion.heard import HeardStep
from flexmotion.streamer.motion.intents import Intent, Text, Velocity
from flexmotion.streamer.motion.measured_steps import (
    NothingChangesError,
    RefusedError,
    at_rate,
    fits,
    measured,
    on_the_spot,
)
from flexmotion.streamer.motion.programs import NOT_SAID, VELOCITY, Program, Step, usual_amount
from flexmotion.streamer.motion.speeds import Model, Speeds, velocity_text
from flexmotion.text.amounts import Amount
from flexmotion.text.clause import NO_KNOWN_WORD, UNITS, Asks, Clause
from flexmotion.text.ellipsis import BACK, FORWARD, other_limb, with_limb, with_side
from flexmotion.text.limbs import lowered_arm
from flexmotion.text.manners import NORMAL
from flexmotion.text.part_phrases import part_phrase
from flexmotion.text.phrases import BOTH_UP, STAND, limbs, moves_head
from flexmotion.text.prompt_reader import Prompt
from flexmotion.text.questions import QUESTION
from flexmotion.text.refusals import (
    goes_ahead,
    in_place,
    is_no_stand,
    is_no_walk,
    is_turning,
    is_unlike,
)
from flexmotion.text.shaping import TO_WHICH_SIDE
from flexmotion.text.sides import LEFT, RIGHT, sides
from flexmotion.text.vocabulary import vocabulary

RUNS = ("run", "dash")
"""Kinds of motion that go straight ahead, and to no side."""
NOT_HELD = "ends, or begins anew, and is not held"


class ClauseSteps:
    """Makes steps of requests, or refuses them.

    Args:
        model: that follows them.
        pace: greatest speed of the human; None: no limit.
        speeds: of motions and their changes.
    """

    def __init__(self, model: Model, pace: Pace | None, speeds: Speeds) -> None:
        self.model, self.pace, self.speeds = model, pace, speeds

    def standing(self, sentence: str) -> Step:
        """A stand for these words."""
        told = HeardStep(text=sentence, heard_as=STAND, certainty=1.0)
        return Step(Text("stand still"), STAND, None, (0, 0), 0, None, told)

    def of(
        self, clause: Clause, in_sequence: bool, before: list[Step], under_way: Program | None, last: Program | None
    ) -> list[Step]:
        """The steps of a request; those before it may be changed ("walk slowly ... for two metres").

        Args:
            in_sequence: whether other requests follow or precede it: what has no end gets one.
            before: steps of the sentence before it, changed in place.
            under_way: what the robot does now; last: what "again" repeats.

        Raises:
            RefusedError: it is not done, with the reason.
        """
        if clause.refusal is not None:
            prompt = self.model.prompt(clause.text)
            told = prompt.warning if clause.refusal in (NO_KNOWN_WORD, QUESTION) and not prompt.known else None
            raise RefusedError(told or f"{clause.said!r}: {clause.refusal}")
        if clause.asks is Asks.AGAIN:
            moved = [step for step in before if step.kind != STAND][-1:] or before[-1:]  # "bow, wait, then again"
            repeated = moved if before else list(last.steps) if last is not None else []
            if clause.text:
                repeated = self._named(clause, [*(() if last is None else last.steps), *before])
            if not repeated:
                raise RefusedError("nothing was done before that could be repeated")
            if clause.side is not None:
                repeated = [self._to_side(step, clause) for step in repeated]
            if clause.amount is not None:
                if len(repeated) != 1 or clause.amount.quantity not in ("time", *fits(repeated[0])):
                    raise RefusedError(f"{clause.said!r}: what was done before has no {clause.amount.said!r}")
                repeated = [self._measured(repeated[0], clause.amount, 1)]
            if clause.more and (single := _further(clause, repeated)) is not None:
                return [self._measured(repeated[0], single, 1)]
            repeated = repeated * clause.times
            # A motion without an end has one where another follows it.
            ends = in_sequence or len(repeated) > 1
            return [
                self._measured(step, usual_amount(step, 1), 1) if ends and step.amount is None else step
                for step in repeated
            ]
        if clause.asks is Asks.CONTINUE:
            kind = before[-1].kind if before else ""
            if kind in vocabulary().words("held_not") and clause.said.startswith(vocabulary().phrases("hold")):
                raise RefusedError(f"{clause.said!r}: {kind} {NOT_HELD}")
            if clause.amount is None and in_sequence:
                return []
            return self._continued(clause, before, under_way, last)
        if clause.asks is not Asks.MOTION:
            if not before:
                raise RefusedError(f"{clause.said!r}: say it alone, while the motion is under way")
            changed = self.speeds.changed(before[-1], clause.speed)
            if changed is before[-1]:
                which = "smallest" if clause.speed < 1.0 else "greatest"
                raise RefusedError(f"{clause.said!r}: {changed.kind} is at its {which} speed already")
            slowed = None if clause.speed < 1.0 else changed.told.slowed
            changed = replace(changed, told=changed.told.model_copy(update={"slowed": slowed}))
            if clause.joint == "then":
                # "Walk, then walk slower": one after the other.
                return [self._measured(changed, usual_amount(changed, 1), 1)]
            before[-1] = changed
            return []
        clause = self._lowering(clause, before or ([] if under_way is None else list(under_way.steps)))
        return [self._motion(self._with_limb(clause, [*(() if last is None else last.steps), *before]), in_sequence)]

    def _named(self, clause: Clause, done: Sequence[Step]) -> list[Step]:
        """For "repeat the turn": the last step of that motion; a gesture can be done without one before."""
        known, prompt = vocabulary(), self.model.prompt(clause.text)
        turns, walks = (clause.text in known.words(f"{name}_verbs") for name in ("turn", "walk"))
        for step in reversed(done):
            if turns:
                named = step.turn != 0
            elif walks:
                named = step.axis != (0, 0)
            else:
                named = step.kind.split("-")[0] == prompt.kind.split("-")[0] and step.kind != STAND
            if named:
                return [step]
        if turns or walks or not prompt.known or prompt.kind == STAND:
            raise RefusedError(f"{clause.said!r}: no {clause.text} was done before that could be repeated")
        return [self._motion(replace(clause, asks=Asks.MOTION, times=1, counted=False), in_sequence=False)]

    def _continued(
        self, clause: Clause, before: list[Step], under_way: Program | None, last: Program | None
    ) -> list[Step]:
        """For "after five seconds", "for two metres": more of the motion before, or of the one under way."""
        if clause.amount is None:
            if not before and under_way is None:
                raise RefusedError("nothing is under way that could go on")
            return [] if before or under_way is None else [under_way.steps[-1]]
        if clause.more:
            return [self._more(clause, before, under_way, last)]
        if before:
            amount = before[-1].amount
            if amount is None or amount.quantity == "time" or amount.said == NOT_SAID:
                before[-1] = self._measured(before[-1], clause.amount, 1)
                return []
            return [self._measured(self.standing(clause.said), clause.amount, 1)]
        current = self.standing(clause.said) if under_way is None else under_way.steps[-1]
        return [self._measured(current, clause.amount, 1)]

    def _measured(self, step: Step, amount: Amount, times: int) -> Step:
        return measured(self.model, self.pace, step, amount, times)

    def _more(self, clause: Clause, before: list[Step], under_way: Program | None, last: Program | None) -> Step:
        """For "two more steps": of the motion before, where it has such an amount."""
        assert clause.amount is not None
        program = under_way or last
        done = before or ([] if program is None else list(program.steps))
        if done and clause.amount.quantity in fits(done[-1]):
            return self._measured(done[-1], clause.amount, 1)
        if not clause.text or clause.amount.quantity == "angle":
            raise RefusedError(f"{clause.said!r}: nothing was done before that could go on so far")
        return self._motion(replace(clause, asks=Asks.MOTION), in_sequence=True)

    def _to_side(self, step: Step, clause: Clause) -> Step:
        """A step to another side, or with another hand, as much of it as before."""
        assert clause.side is not None
        walks = step.turn != 0 or step.axis != (0, 0)
        if walks and vocabulary().words("limbs") & set(clause.said.split()):
            raise RefusedError(f"{clause.said!r}: {step.kind} is not a motion of the hands")
        ahead = step.kind == STAND or (not walks and clause.side in (BACK, FORWARD)) or step.kind == VELOCITY
        if ahead or not isinstance(step.intent, Text | Velocity):
            raise RefusedError(f"{clause.said!r}: {step.kind} has no other side")
        spot = step.turn != 0 and isinstance(step.intent, Velocity) and step.intent.forward == 0.0
        tempo = step.intent.tempo if isinstance(step.intent, Text) else 1.0
        asked = Clause(clause.said, with_side(step.told.text, clause.side), speed=tempo, on_the_spot=spot)
        mirrored = self._motion(asked, in_sequence=False)
        if step.beside is not None:
            mirrored = mirrored.with_beside_of(step)
        return mirrored if step.amount is None else self._measured(mirrored, step.amount, 1)

    def _lowering(self, clause: Clause, done: Sequence[Step]) -> Clause:
        """The clause with what leaves one arm down and the other as it is, where it asks to lower one."""
        lowered = lowered_arm(clause.text)
        if lowered is None:
            return clause
        (side, arm), kind = lowered, done[-1].kind if done else STAND
        down = replace(clause, text="lower your arms")
        if kind == STAND:
            return down
        raised = sides(kind) if "arm" in (limbs(kind) or ()) else frozenset()
        if "arm" not in (limbs(kind) or ()):
            raise NothingChangesError(f"{clause.said!r}: {kind} raises no arm")
        if raised and side not in raised:
            raise NothingChangesError(f"{clause.said!r}: {kind} does not raise the {side} {arm}")
        if raised:
            return down
        if side == "other":
            raise NothingChangesError(f"{clause.said!r}: which {arm}? say left or right")
        if kind == BOTH_UP:
            return replace(clause, text=f"raise your {'right' if side == 'left' else 'left'} hand")
        raise NothingChangesError(f"{clause.said!r}: {kind} is no motion of that {arm} alone; say 'lower your arms'")

    def _with_limb(self, clause: Clause, done: Sequence[Step]) -> Clause:
        """The clause with the side of "the other hand": not that of the last gesture which one hand made."""
        limb = other_limb(clause.text)
        if limb is None or len(sides(self.model.prompt(clause.text).kind)) != 1:
            return clause  # "add the other hand and wave both"
        groups: dict[str, list[str]] = vocabulary().table["limb_groups"]
        for step in reversed(done):
            used = {name for group in limbs(step.kind) or () for name in groups[group]}
            side = sides(step.kind)
            if len(side) == 1 and limb in used and step.turn == 0 and step.axis == (0, 0):
                return replace(clause, text=with_limb(clause.text, LEFT if RIGHT in side else RIGHT))
        raise RefusedError(f"{clause.said!r}: which {limb}? say left or right")

    def _motion(self, clause: Clause, in_sequence: bool) -> Step:
        step = self.single_motion(clause, in_sequence)
        if clause.beside is None:
            return step
        gesture = self.single_motion(clause.beside, in_sequence=False)
        step = step.with_beside(gesture)
        share = 1.0 if self.pace is None else self.pace.curve_with_arms
        curves = step.turn != 0 and not (isinstance(step.intent, Velocity) and step.intent.forward == 0.0)
        wide = curves and "arm" in (limbs(gesture.kind) or ()) and not sides(gesture.kind)
        if not wide or share == 1.0 or clause.speed != 1.0 or clause.rate is not None:
            return step
        slower = self.speeds.changed(step, share)
        assert isinstance(slower.intent, Velocity)
        speed = velocity_text((slower.intent.forward, slower.intent.left, slower.intent.turning))
        told = f"a human's {speed}, so that the robot can follow"
        return replace(slower, told=slower.told.model_copy(update={"slowed": told}))

    def single_motion(self, clause: Clause, in_sequence: bool) -> Step:
        """The step of a request without what is done beside it.

        Raises:
            RefusedError: as of `of`.
        """
        if not clause.text:
            raise RefusedError(f"{clause.said!r} is not understood: it names no motion")
        prompt = self.model.prompt(clause.text)
        if clause.needs_head and not moves_head(prompt.refused or prompt.kind):
            if part_phrase(clause.said) is not None:
                raise RefusedError(f"{clause.said!r}: a motion of the head; say it in a sentence of its own")
            if prompt.kind == STAND:
                raise RefusedError(f"{clause.said!r}: where to? say left, right, up, down or behind you")
            raise RefusedError(f"{clause.said!r}: looking and moving the head are not what {prompt.kind} does")
        if not prompt.known:
            raise RefusedError(prompt.warning or f"{clause.text!r} is not understood")
        if prompt.warning is not None:
            return self.standing(clause.said)  # a prohibition, such as "stop that at once"
        if prompt.kind == STAND and is_no_stand(clause.text):
            if is_turning(clause.text) and len(clause.text.split()) == 1:
                raise RefusedError(f"{clause.said!r}: {TO_WHICH_SIDE}")
            raise RefusedError(f"{clause.text!r} is not understood: no known motion is like it")
        table = vocabulary().table
        feet = prompt.kind in table["walks"] or prompt.kind in table["turns"]
        if (feet and is_no_walk(clause.text)) or is_unlike(clause.text, prompt.kind):
            raise RefusedError(f"{clause.said!r} is not understood: no known motion is like it")
        if prompt.kind in RUNS and sides(clause.text):
            raise RefusedError(f"{clause.said!r}: {prompt.kind} goes straight ahead; say 'walk to the left'")
        axis = tuple(table["walks"].get(prompt.kind, (0, 0)))
        turn = int(table["turns"].get(prompt.kind, 0))
        intent: Intent = Text(clause.text)
        condition = Condition(clause.text, pace=self.pace)
        slowed = self.speeds.slowed(condition)
        rhythm = self.model.rhythm(replace(condition, tempo=clause.speed))
        if rhythm is not None:
            intent = Text(clause.text, rhythm.speed)
        manner = None if prompt.manner == NORMAL or rhythm is not None else prompt.manner
        told = HeardStep(
            text=clause.text, heard_as=prompt.kind, manner=manner, certainty=rounded(prompt), slowed=slowed
        )
        step = Step(intent, prompt.kind, None, (int(axis[0]), int(axis[1])), turn, None, told, rhythm=rhythm)
        spot = turn != 0 and (clause.on_the_spot or in_place(clause.text))
        if spot and goes_ahead(clause.text):
            raise RefusedError(
                f"{clause.said!r}: that turn walks ahead; say 'turn left on the spot', or leave that out"
            )
        if spot and not self.model.follows_velocity:
            raise RefusedError(f"{clause.said!r}: this model turns as it walks ahead, and not on the spot")
        if spot:
            step = on_the_spot(self.pace, step)
        # What is said in figures counts: "slowly at 0.3 m/s".
        if clause.rate is None and clause.speed != 1.0 and (turn or step.axis != (0, 0)):
            changed = self.speeds.changed(step, clause.speed)
            if clause.speed < 1.0 and changed is step:
                raise RefusedError(f"{clause.said!r}: {step.kind} is at its smallest speed already")
            if changed is not step:
                told = changed.told.model_copy(update={"slowed": None if clause.speed < 1.0 else told.slowed})
                step = replace(changed, told=told)
        amount, times = clause.amount, clause.times
        if amount is None and (in_sequence or clause.counted):
            amount = usual_amount(step, times)
            if clause.counted and amount.quantity == "times":
                amount = replace(amount, value=float(times), said=f"{times} times")
            times = 1 if amount.quantity != "times" else times
        if clause.rate is not None:
            spot = spot or (amount is not None and amount.quantity == "angle")
            step = at_rate(self.speeds, step, clause.rate, spot)
        if amount is None:
            return step
        if step.kind == STAND and amount.quantity not in ("time", "times"):
            raise RefusedError(f"{clause.said!r} is not understood: standing has no {amount.said!r}")
        return self._measured(step, amount, times)


def _further(clause: Clause, repeated: Sequence[Step]) -> Amount | None:
    """How many more of one motion a request asks for; None where all of what was done before is repeated.

    "Bow three times, then once more" is four bows; "nod", then "three more times", three more nods.

    Raises:
        RefusedError: "two more" of what is not counted.
    """
    done = repeated[-1].amount
    unsaid = done is None or done.said == NOT_SAID
    named = vocabulary().words("counts") | {"time", "times", "one"}
    nameless = clause.counted and not named & set(clause.said.split())  # "two more"
    if len(repeated) == 1 and done is not None and not unsaid:
        if done.quantity == "times" or (nameless and done.quantity == "steps"):
            return Amount(float(clause.times), done.quantity, clause.said)
    elif len(repeated) == 1 and repeated[0].rhythm is not None:
        return Amount(float(clause.times), "times", clause.said)
    if nameless and (len(repeated) > 1 or repeated[0].turn or repeated[0].axis != (0, 0)):
        raise RefusedError(f"{clause.said!r}: of what? {UNITS}")
    return None


def rounded(prompt: Prompt) -> float:
    """The listener's share of what it heard, as it is told."""
    return round(float(prompt.share), 4)
