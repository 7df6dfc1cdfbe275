"""`Hearing`: a sentence to a program of steps, each with a motion, an amount and a time limit, and to its answer.

The grammar (`flexmotion/text/grammar.py`) finds the requests, the model's listener the kind of motion of each. What
cannot be done, or only in part, is said in the answer. If one request of a sentence is refused, all of it is: what
follows would be done in another place than it was meant for.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from math import log

from flexmotion.sampling.pace import Pace
from flexmotion.sampling.sampler import Condition
from flexmotion.streamer.motion.at_once import together
from flexmotion.streamer.motion.clause_steps import NOT_HELD, ClauseSteps, rounded
from flexmotion.streamer.motion.gesture_change import gesture_change
from flexmotion.streamer.motion.gesture_words import ends_gesture
from flexmotion.streamer.motion.heard import Heard, HeardStep
from flexmotion.streamer.motion.intents import Clip, Heading, Intent, Stop, Text, Velocity, Waypoint, word_of, words_of
from flexmotion.streamer.motion.measured_steps import (
    NothingChangesError,
    RefusedError,
)
from flexmotion.streamer.motion.programs import MOST_STEPS, VELOCITY, Program, Step
from flexmotion.streamer.motion.speeds import Model, Speeds, velocity_text
from flexmotion.text.alarm import is_alarm
from flexmotion.text.amounts import Amount
from flexmotion.text.clause import Asks, Clause
from flexmotion.text.clauses import UNSEEN
from flexmotion.text.grammar import parse, whole
from flexmotion.text.manner_phrases import manner_alone, manner_phrases, without_phrases
from flexmotion.text.manners import NORMAL, manner_words, manners
from flexmotion.text.phrases import STAND, WALK, is_pose, limbs
from flexmotion.text.postures import moves_along
from flexmotion.text.prompt_reader import Prompt
from flexmotion.text.refusals import (
    is_turning,
    moves_feet,
    names_head,
)
from flexmotion.text.restriction_refusals import restriction_refusal
from flexmotion.text.sides import sides
from flexmotion.text.spelling import as_meant
from flexmotion.text.vocabulary import vocabulary
from flexmotion.text.wording import stem

BOTH_HANDS = re.compile(r"\bboth (?:your |of your |the )?(?:hands|arms)\b")
"""What a gesture of one hand does with one of them."""

PACED = 0.5
"""Least share of the asked change of a rhythm's speed, by its logarithm, by which its adverb was done."""

_HALTS = re.compile(r"\bto a (?:complete |full )?(?:stop|halt|standstill)\b", re.IGNORECASE)
"""Words of a stop that the grammar rewords: "come to a stop waving" is no end of the wave alone."""


class Hearing:
    """Maps intents to programs.

    Args:
        model: that follows them.
        pace: greatest speed of the human; None: no limit.
        seconds: gives the length of a clip [s].
    """

    def __init__(self, model: Model, pace: Pace | None, seconds: Callable[[Clip], float] | None = None) -> None:
        self.model, self.pace, self.speeds, self.seconds = model, pace, Speeds(model, pace), seconds
        self.steps = ClauseSteps(model, pace, self.speeds)

    def __call__(self, intent: Intent, under_way: Program | None = None, last: Program | None = None) -> Program:
        """The program of an intent.

        Args:
            under_way: what the robot does now, for "faster" and the like; None: it stands.
            last: what "again" repeats; None: nothing yet.
        """
        match intent:
            case Text(text) if is_alarm(text):
                return self._alarmed(text)
            case Text(text) if (restricts := restriction_refusal(text)) is not None:
                return self._refused(text, restricts)
            case Text(text):
                meant, notes = as_meant(text, self.model.is_word)
                program = self._sentence(meant, under_way, last)
                heard = program.heard.model_copy(update={"asked": text, "notes": (*notes, *program.heard.notes)})
                return replace(program, heard=heard) if notes else program
            case Velocity(forward, left, turning):
                asked = words_of(intent)
                slowed = self.speeds.slowed(Condition(velocity=(forward, left, turning), pace=self.pace))
                heard = Heard(asked=asked, state="slowed" if slowed else "accepted", slowed=slowed)
                step = Step(intent, VELOCITY, None, (0, 0), 0, None, HeardStep(text=asked, heard_as=VELOCITY))
                before = None if under_way is None else under_way.steps[0]
                if before is not None and before.kind == VELOCITY and not step.is_still:
                    step = step.with_beside_of(before)  # the next message of a stick ends no gesture
                return Program((step,), heard.model_copy(update={"heard_as": step.told.motion}))
            case Clip(name) if self.seconds is not None:
                seconds = self.seconds(intent)
                told = HeardStep(text=name, heard_as="clip", amount=round(seconds, 3), unit="time")
                step = Step(intent, "clip", Amount(seconds, "time", name), (0, 0), 0, seconds + 2.0, told)
                return Program((step,), Heard(asked=name, state="accepted", heard_as="clip", steps=(told,)))
            case Heading() | Waypoint():
                kind, words = word_of(intent), words_of(intent)
                told = HeardStep(text=words, heard_as=kind)
                step = Step(Text("stand still"), kind, None, (0, 0), 0, None, told, intent)
                return Program((step,), Heard(asked=words, state="accepted", heard_as=kind, steps=(told,)))
        words = words_of(intent) if isinstance(intent, Stop) else repr(intent)
        heard = Heard(asked=words, state="accepted", heard_as=STAND)
        return Program((Step(intent, STAND, None, (0, 0), 0, None, HeardStep(text=words, heard_as=STAND)),), heard)

    def _sentence(self, sentence: str, under_way: Program | None, last: Program | None) -> Program:
        if (way := manner_alone(sentence)) is not None:
            return self._in_manner(sentence, way, under_way)
        parsed = together(parse(sentence), self.model)
        clauses = self._requests(sentence, parsed)
        dropped = tuple(part for clause in clauses for part in clause.dropped)
        notes = tuple(note for clause in clauses for note in clause.notes)
        try:
            own = () if _HALTS.search(sentence) else parsed
            change = gesture_change(own, under_way, partial(self.steps.single_motion, in_sequence=False), self.model)
            if change is not None and under_way is not None:
                step, note, left_out = change
                return self._goes_on_with(sentence, [step], note, left_out, under_way.number)
            wanted = self._without_forbidden(sentence, clauses)
            if len(wanted) == 1 and (changed := self._changed(sentence, wanted[0], under_way)) is not None:
                return changed
            steps: list[Step] = []
            wanted = self._without_ends(wanted)
            several = len([clause for clause in wanted if not _changes_last(clause)]) > 1
            for clause in wanted:
                if clause is not wanted[-1] and clause.until_told:
                    raise RefusedError(f"{clause.said!r}: it ends when you say so; say then what follows")
                steps += self.steps.of(clause, several, steps, under_way, last)
                at_a_speed = clause.rate is not None or (clause.speed != 1.0 and isinstance(steps[-1].intent, Velocity))
                if at_a_speed and steps[-1].told.slowed is None:
                    notes += (f"done {_speed_text(steps[-1].intent)}",)
            if len(parsed) == 1 and steps and under_way is not None and _is_more(parsed[0], steps[-1], under_way):
                steps[-1] = steps[-1].with_beside_of(under_way.steps[-1])
            if len(wanted) == 1 and _goes_on(wanted[0], steps[-1:], under_way):
                notes += ("it goes on",)
            if len(steps) > MOST_STEPS:
                raise RefusedError(f"{len(steps)} requests in one sentence, at most {MOST_STEPS}")
        except NothingChangesError as refused:
            # Beside other requests, such as a stop, none is done, and nothing goes on without them.
            if under_way is None or len(clauses) != 1:
                return self._refused(sentence, str(refused), dropped, notes)
            heard = Heard(asked=sentence, state="refused", reason=f"{refused}; it goes on", certainty=1.0)
            return replace(under_way, heard=heard)
        except RefusedError as refused:
            return self._refused(sentence, str(refused), dropped, notes)
        if not steps:
            reason = "it says only what not to do: the robot stands still"
            steps, dropped = [self.steps.standing(sentence)], ()
            heard = Heard(asked=sentence, state="accepted", heard_as=STAND, certainty=1.0, reason=reason)
            return Program(tuple(steps), heard.model_copy(update={"steps": (steps[0].told,)}))
        for clause in wanted:
            for one in (clause, clause.beside):
                heard_words = "" if one is None or one.asks is not Asks.MOTION else one.text
                dropped += self.model.prompt(heard_words).dropped if heard_words else ()
        for clause, step in zip(wanted, steps, strict=False):
            dropped = tuple(dict.fromkeys((*dropped, *_ignored(clause, step))))
            notes += () if step.rhythm is None or clause.manner not in dropped else (_pace_limit(step, clause.speed),)
            if clause.beside is not None:
                gesture_step = self.steps.single_motion(clause.beside, in_sequence=False)
                dropped = tuple(dict.fromkeys((*dropped, *_ignored(clause.beside, gesture_step))))
                manner = gesture_step.told.manner
                notes += () if manner is None else (f"{gesture_step.kind}: {manner}",)
        if not any(step.turn or step.axis != (0, 0) for step in steps):
            notes = tuple(note for note in notes if not note.startswith(UNSEEN))  # "come here and shake my hand"
        slowed = next((step.told.slowed for step in steps if step.told.slowed), None)
        certainties = [step.told.certainty for step in steps if step.told.certainty is not None]
        heard = Heard(
            asked=sentence,
            state="partly" if dropped else "slowed" if slowed else "accepted",
            heard_as=_kinds(steps),
            manner=_manners(steps),
            certainty=min(certainties, default=None),
            slowed=slowed,
            dropped=dropped,
            notes=notes,
            steps=tuple(step.told for step in steps),
        )
        return Program(tuple(steps), heard)

    def _requests(self, sentence: str, clauses: tuple[Clause, ...]) -> tuple[Clause, ...]:
        """The requests of a sentence; a sentence whose parts only qualify each other is one, for the listener.

        "Step to the left, keep facing me": no motion is known for the second part, and no order is said.
        """
        clauses = self._held(clauses)
        if len(clauses) < 2 or any(clause.joint == "then" or clause.forbidden for clause in clauses):
            return clauses
        qualifiers = vocabulary().phrases("qualifiers")
        if not any(_begins_with(clause, qualifiers) for clause in clauses):
            return clauses
        if self._are_gestures(clauses):
            return clauses
        one = whole(sentence)
        refused = any(self.model.prompt(clause.text).refused is not None for clause in clauses if clause.text)
        if one is None or refused or not self.model.prompt(one.text).known:
            return clauses
        looks = tuple(clause.said for clause in clauses if names_head(clause.said))
        return (one if one.needs_head else replace(one, dropped=(*one.dropped, *looks)),)

    def _are_gestures(self, clauses: Sequence[Clause]) -> bool:
        """Whether each request is another gesture, and those behind the first are of arms.

        "Bow and hold up your left hand" is two, "walk and hold your arms up" is one.
        """
        prompts = [self.model.prompt(clause.text) for clause in clauses if clause.text]
        used = [limbs(one.kind) or frozenset() for one in prompts]
        arms = all(one.known and own == frozenset(["arm"]) for one, own in zip(prompts[1:], used[1:], strict=True))
        return arms and len({one.kind for one in prompts}) == len(clauses) and "leg" not in used[0]

    def _held(self, clauses: tuple[Clause, ...]) -> tuple[Clause, ...]:
        """The requests without those that a pose is held, as it is: "raise your hand and hold it".

        Other motions are not held, and such a request is refused.
        """
        found: list[Clause] = []
        for clause in clauses:
            kind = self.model.prompt(found[-1].text).kind if found and found[-1].text else ""
            if clause.said in vocabulary().phrases("hold") and is_pose(kind):
                continue
            if clause.said in vocabulary().phrases("hold") and kind in vocabulary().words("held_not"):
                clause = replace(clause, refusal=f"{kind} {NOT_HELD}")
            found.append(clause)
        return tuple(found)

    def _refused(
        self, sentence: str, reason: str, dropped: tuple[str, ...] = (), notes: tuple[str, ...] = ()
    ) -> Program:
        """The robot stands still. Of the notes only those of what else it cannot do are of account."""
        whole = reason if "stands still" in reason else f"{reason}; the robot stands still"
        heard = Heard(
            asked=sentence,
            state="refused",
            certainty=rounded(self.model.prompt(sentence)),
            dropped=dropped,
            reason=whole,
            notes=tuple(note for note in notes if note.startswith(tuple(map(repr, dropped)))),
        )
        return Program((self.steps.standing(sentence),), heard)

    def _alarmed(self, sentence: str) -> Program:
        """Of a script: the gateway has made a STOP of such words before they come here."""
        step = self.steps.standing(sentence)
        notes = ("taken as a stand; an emergency stop is not asked for in words",)
        heard = Heard(asked=sentence, state="accepted", heard_as=STAND, certainty=1.0, notes=notes, steps=(step.told,))
        return Program((step,), heard)

    def _without_ends(self, clauses: Sequence[Clause]) -> list[Clause]:
        """The requests without those that only end a gesture: "walk a metre while waving, then stop waving and walk".

        What follows has none. Where nothing follows, the robot is to stand.
        """
        gestures = [None, *(clause.beside for clause in clauses)]
        kinds = [None if one is None else self.model.prompt(one.text).kind for one in gestures]
        last = len(clauses) - 1
        return [
            clause
            for number, (clause, kind) in enumerate(zip(clauses, kinds, strict=False))
            if kind is None or number == last or not ends_gesture(clause, kind, self.model)
        ]

    # ------------------------------------------------------------ what is forbidden

    def _without_forbidden(self, sentence: str, clauses: Sequence[Clause]) -> list[Clause]:
        """The clauses that ask for something; refuses a sentence that asks for what it forbids."""
        forbidden: list[tuple[str, str]] = []  # kinds, each with the words that forbid it
        wanted = [clause for clause in clauses if not clause.forbidden]
        moving = any(self._moves(clause) for clause in wanted)
        for clause in (one for one in clauses if one.forbidden):
            if clause.text.split()[:1] and clause.text.split()[0] in vocabulary().words("still_verbs"):
                continue  # "raise your hand and don't lower it"
            if words := _words_of_a_manner(clause.text):
                if any(words & set(one.text.split()) for one in wanted):
                    raise RefusedError(f"{clause.said!r}: that manner is asked for and forbidden in one sentence")
                continue  # "walk without limping"; a listener takes single words for many things
            prompt = self.model.prompt(clause.text) if clause.text else None
            if (stays := moves_feet(clause.text)) or is_turning(clause.text):
                kinds = [*(vocabulary().table["walks"] if stays else ()), *vocabulary().table["turns"]]
                forbidden += [(kind, clause.text) for kind in kinds]
                continue
            unknown = prompt is not None and (not prompt.known or prompt.kind == STAND)
            if moves_along(clause.text) or (clause is not clauses[0] and unknown and _qualifies(clause)):
                if moving:
                    reason = "the robot cannot promise that; say what it is to do without it"
                    raise RefusedError(f"{clause.said!r}: {reason}")
                if wanted:
                    continue  # "stand still, don't move your arms"
            if prompt is not None and prompt.kind in vocabulary().table["walks"] and _says_manner(prompt):
                if any(_same_manner(prompt, self.model.prompt(one.text)) for one in wanted if one.text):
                    raise RefusedError(f"{clause.said!r}: that manner is asked for and forbidden in one sentence")
                continue  # "walk without limping" forbids a manner
            if prompt is not None and prompt.refused is not None:
                continue  # "walk, don't clap": the model cannot clap
            if prompt is not None and not prompt.known and moving:
                raise RefusedError(f"{clause.said!r} is not understood, and the robot cannot promise it; leave it out")
            if prompt is None or not prompt.known or prompt.kind == STAND:
                return []  # "walk forward, no, don't", "don't move and wave": nothing moves
            forbidden.append((prompt.kind, clause.text))
        for clause in wanted:
            if clause.asks is Asks.MOTION and clause.refusal is None:
                asked = [one.text for one in (clause, clause.beside) if one is not None]
                if any(_covers(one, text, self.model.prompt(own).kind) for one, text in forbidden for own in asked):
                    raise RefusedError(f"{clause.said!r} is asked for and forbidden in one sentence")
            elif clause.asks is not Asks.MOTION and forbidden:
                raise RefusedError(f"{clause.said!r} could mean what the sentence forbids")
        if any(one == WALK for one, _ in forbidden):
            return [replace(clause, on_the_spot=True) for clause in wanted]  # "turn left, no walking"
        return wanted

    def _moves(self, clause: Clause) -> bool:
        """Whether a clause asks for anything but standing."""
        return clause.asks is not Asks.MOTION or self.model.prompt(clause.text).kind != STAND

    # ------------------------------------------------------------ what is under way

    def _changed(self, sentence: str, clause: Clause, under_way: Program | None) -> Program | None:
        """The same program at another speed, which goes on where it is; None where a clause asks for no such thing."""
        if clause.asks not in (Asks.FASTER, Asks.SLOWER):
            return None
        if any(self.model.prompt(rest).known for rest in clause.dropped):
            raise RefusedError(f"{clause.dropped[0]!r}: say it alone, or after 'then'")
        if under_way is None or all(step.kind == STAND or step.is_still for step in under_way.steps):
            raise RefusedError("nothing is under way whose speed could change")
        steps = [self.speeds.changed(step, clause.speed) for step in under_way.steps]
        moved = [step for step, old in zip(steps, under_way.steps, strict=True) if step is not old]
        if not moved:
            which = "greatest" if clause.asks is Asks.FASTER else "smallest"
            kinds = ", ".join(dict.fromkeys(step.kind for step in under_way.steps))
            paced = any(
                step.axis != (0, 0) or step.turn or step.kind == VELOCITY or step.rhythm for step in under_way.steps
            )
            reason = f"{kinds} is at its {which} speed already" if paced else f"{kinds} has one speed"
            heard = Heard(asked=sentence, state="refused", reason=f"{reason}; it goes on", certainty=1.0)
            return replace(under_way, heard=heard)
        told = ", ".join(dict.fromkeys(_speed_text(step.intent) for step in moved))
        return self._goes_on_with(sentence, steps, f"now {told}", clause.dropped, under_way.number)

    def _goes_on_with(
        self, sentence: str, steps: Sequence[Step], note: str, dropped: tuple[str, ...], number: int
    ) -> Program:
        """The program under way, of a number, with other steps, which go on where it is."""
        heard = Heard(
            asked=sentence,
            state="partly" if dropped else "accepted",
            heard_as=_kinds(steps),
            manner=_manners(steps),
            certainty=1.0,
            dropped=dropped,
            notes=(note,),
            steps=tuple(step.told for step in steps),
        )
        return Program(tuple(steps), heard, number)

    def _in_manner(self, sentence: str, way: str, under_way: Program | None) -> Program:
        """What is under way in another manner, which goes on where it is.

        Args:
            way: the words that say the manner.
        """
        step = None if under_way is None else under_way.steps[0]
        if under_way is None or step is None or step.kind == STAND or step.is_still:
            reason = f"{sentence!r} says only how; say what to do as well, as in 'walk {way}'"
            return self._refused(sentence, reason)
        kept = step.told.text
        text = f"{without_phrases(kept, manner_phrases(kept))} {way}"
        prompt = self.model.prompt(text)
        walks = under_way.is_open and (step.turn or step.axis != (0, 0)) and isinstance(step.intent, Text | Velocity)
        known = all(phrase.manner is not None and not phrase.doubtful for phrase in manner_phrases(way))
        if walks and prompt.dropped and not known:
            # Words of no manner may have meant to end the walk.
            return self._refused(sentence, f"{sentence!r}: no manner that is known")
        if not walks or prompt.kind != step.kind or prompt.manner == NORMAL or prompt.dropped:
            which = "the model has no such manner" if walks and prompt.dropped else f"say all of it, as in {text!r}"
            reason = f"{sentence!r}: {step.kind} is not changed to that manner: {which}; it goes on"
            return replace(under_way, heard=Heard(asked=sentence, state="refused", reason=reason, certainty=1.0))
        intent: Intent
        if isinstance(step.intent, Velocity):
            velocity = step.intent.forward, step.intent.left, step.intent.turning
            intent, asked = replace(step.intent, manner=prompt.manner), Condition(velocity=velocity, pace=self.pace)
        else:
            intent, asked = Text(text, beside=step.beside), Condition(text, pace=self.pace)
        slowed = self.speeds.slowed(asked)
        told = step.told.model_copy(update={"text": text, "manner": prompt.manner, "slowed": slowed})
        heard = Heard(
            asked=sentence,
            state="accepted" if slowed is None else "slowed",
            heard_as=told.motion,
            manner=prompt.manner,
            certainty=rounded(prompt),
            slowed=slowed,
            notes=("it goes on in that manner",),
            steps=(told,),
        )
        return Program((replace(step, intent=intent, told=told),), heard, under_way.number)

    # ------------------------------------------------------------ from a clause to its steps


def _kinds(steps: Sequence[Step]) -> str:
    """Kinds of motion of the steps, with the gestures that are made meanwhile."""
    return ", ".join(step.told.motion for step in steps)


def _manners(steps: Sequence[Step]) -> str | None:
    """Manners of the steps; None where all are normal."""
    said = [step.told.manner or NORMAL for step in steps]
    return None if set(said) <= {NORMAL} else ", ".join(said)


def _begins_with(clause: Clause, phrases: Sequence[str]) -> bool:
    """Whether a motion without an amount begins with one of some phrases."""
    motion = clause.asks is Asks.MOTION and clause.amount is None and clause.refusal is None
    return motion and any(f"{clause.text} ".startswith(f"{phrase} ") for phrase in phrases)


def _covers(forbidden: str, text: str, kind: str) -> bool:
    """Whether a kind of motion is among what a prohibition of another means: not to walk is not to walk anywhere.

    Args:
        text: words of the prohibition: not to walk ahead is not to go ahead in any way, and leaves other ways; not to
            walk leaves running.
    """
    known, words = vocabulary(), text.split()
    walks = known.table["walks"]
    if forbidden == WALK and known.words("onward") & set(words):
        return bool(walks.get(kind) == walks[WALK])
    if forbidden == WALK:
        runs = words[:1] != [] and stem(words[0]) in known.words("walking") and kind in ("run", "dash")
        return kind in walks and not runs
    if forbidden in ("run", "dash"):
        return kind in ("run", "dash")
    return forbidden == kind


def _changes_last(clause: Clause) -> bool:
    """Whether a clause changes the speed of the motion before it, and asks for none of its own: "walk, slowly"."""
    return clause.asks in (Asks.FASTER, Asks.SLOWER) and clause.joint != "then"


def _is_more(clause: Clause, step: Step, under_way: Program) -> bool:
    """Whether a request asks for an amount of what is under way: "for two metres", "keep walking two steps"."""
    more = clause.verbless or clause.text.split()[:1] == ["keep"]
    free = clause.beside is None and not clause.forbidden and clause.amount is not None
    return more and free and step.kind == under_way.steps[-1].kind


def _goes_on(clause: Clause, steps: Sequence[Step], under_way: Program | None) -> bool:
    """Whether a request asks for no more than what is under way: "don't stop", "keep walking"."""
    keeps = clause.asks is Asks.CONTINUE or "keep" in clause.text.split()
    same = under_way is not None and [step.told.motion for step in steps] == [under_way.steps[-1].told.motion]
    return keeps and clause.amount is None and same and steps[0].kind != STAND


def _ignored(clause: Clause, step: Step) -> tuple[str, ...]:
    """Words that change nothing: adverbs of gestures, both hands of a gesture of one; up, of a turn on the spot.

    Standing has none to speak of.
    """
    if clause.asks is not Asks.MOTION:
        return ()
    gesture = not step.turn and step.axis == (0, 0) and step.kind != STAND
    turns_by_angle = step.turn != 0 and step.amount is not None and step.amount.quantity == "angle"
    one_speed = gesture and not _is_paced(step, clause.speed)
    manner = clause.manner if one_speed or (turns_by_angle and clause.speed > 1.0) else ""
    # A recipe has one manner, whatever the model's motions have.
    ways = [] if step.rhythm is None else [phrase.text for phrase in manner_phrases(clause.text) if phrase.manner]
    both = BOTH_HANDS.search(clause.text) if gesture and len(sides(step.kind)) == 1 else None
    told = (manner, clause.degree if gesture else "", *ways, both.group() if both else "")
    return tuple(said for said in told if said)


def _is_paced(step: Step, speed: float) -> bool:
    """Whether a rhythm goes about as fast as a factor on its speed asks."""
    return step.rhythm is not None and speed != 1.0 and log(step.rhythm.speed) / log(speed) >= PACED


def _pace_limit(step: Step, speed: float) -> str:
    """How fast a rhythm is made that does not go as fast, or as slowly, as a factor on its speed asks, in words."""
    assert step.rhythm is not None
    bound = "most" if speed > 1.0 else "least"
    return f"{step.kind} goes at {bound} {step.rhythm.speed:.2g} times its usual speed"


def _qualifies(clause: Clause) -> bool:
    """Whether a prohibition is of how another request is done: "without making noise", "but not too high"."""
    return clause.joint == "but" or clause.said.split()[:1] == ["without"]


def _words_of_a_manner(text: str) -> set[str]:
    """All words of the manner that a text says and nothing else: those of "limp" for "limp"; none for other texts."""
    said = set(text.split())
    return next((words for manner in manners() if said and said <= (words := set(manner_words(manner)))), set())


def _says_manner(prompt: Prompt) -> bool:
    """Whether words say how a motion is done, in a manner of the model or in words that it drops."""
    return prompt.manner != NORMAL or prompt.dropped != ()


def _same_manner(one: Prompt, other: Prompt) -> bool:
    """Whether two prompts say the same manner, or drop the same words: "limp" and "limping"."""
    dropped = ({" ".join(map(stem, part.split())) for part in prompt.dropped} for prompt in (one, other))
    return (one.manner == other.manner != NORMAL) or bool(set.intersection(*dropped))


def _speed_text(intent: Intent) -> str:
    """The speed of an intent, for an answer."""
    if isinstance(intent, Text):
        return f"at {intent.tempo:.2g} times its usual speed"
    assert isinstance(intent, Velocity)
    return f"at a human's {velocity_text((intent.forward, intent.left, intent.turning))}"
