"""`together`: requests of a sentence that are done at the same time, as one: "walk while waving"."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from flexmotion.sampling.beside import fits_beside
from flexmotion.sampling.sampler import Condition
from flexmotion.streamer.motion.programs import GESTURE_S
from flexmotion.streamer.motion.speeds import Model
from flexmotion.text.amounts import Amount
from flexmotion.text.clause import Asks, Clause
from flexmotion.text.grammar import parse
from flexmotion.text.meanwhile import is_posture, meanwhile, says_at_once
from flexmotion.text.phrases import STAND, is_pose, limbs
from flexmotion.text.refusals import is_no_stand
from flexmotion.text.vocabulary import vocabulary
from flexmotion.text.wording import stem

SURE = 0.8
"""Least share of a kind in what the listener hears in a phrase: "with your eyes closed" is none of a gesture."""


def together(clauses: Sequence[Clause], model: Model) -> tuple[Clause, ...]:
    """The requests, in their order, with a gesture of free arms or of the head beside another motion in one.

    What does not fit together stays as it was: one after the other, or left out.

    Args:
        clauses: of a sentence.
        model: that hears them.
    """
    found: list[Clause] = []
    for number, clause in enumerate(clauses):
        # "At the same time" in front of a sentence is of its first two requests, else of the one that it is in.
        telling = (clauses[0], clause) if number == 1 else (clause,)
        joins = clause.joint != "then" and any(says_at_once(phrase) for one in telling for phrase in one.dropped)
        joins = joins or (number > 0 and clause.joint != "then" and _is_kept(found[-1], model))
        both = _both(found[-1], clause, model) if joins and found else None
        if both is not None:
            found[-1] = _told(both)
        else:
            found.append(clause)
    return tuple(_with_phrases(clause, model) for clause in found)


def without_amount(clause: Clause) -> Clause:
    """A request without its end: a gesture beside another motion lasts as long as that one."""
    return replace(clause, amount=None, times=1, counted=False)


def amount_of(clause: Clause) -> str:
    """What a request says of its end, in words."""
    return f"{clause.times} times" if clause.amount is None else clause.amount.said


def _told(clause: Clause) -> Clause:
    """A request of two motions, which are done at the same time as it says."""
    return replace(clause, dropped=tuple(one for one in clause.dropped if not says_at_once(one)))


def _is_kept(clause: Clause, model: Model) -> bool:
    """Whether a request is of a posture that is kept in what follows: "keep your hands up and walk"."""
    heard = model.prompt(clause.text) if is_posture(clause.text) and clause.refusal is None else None
    return heard is not None and heard.known and heard.warning is None and is_pose(heard.kind)


def _with_phrases(clause: Clause, model: Model) -> Clause:
    """A request with the gesture that one of its phrases asks for; of several gestures, with the first.

    Of each that robot or model cannot do is told who cannot.
    """
    for phrase in clause.dropped:
        words, _, others = (meanwhile(phrase) or "").partition(" and ")
        if (vocabulary().words("stop_verbs") | {"stand"}) & {stem(word) for word in others.split()}:
            return replace(clause, refusal=f"{others!r}: say when, with 'then'")
        asked = parse(words) if words else ()
        if len(asked) != 1:
            continue
        other = asked[0] if not others else replace(asked[0], dropped=(*asked[0].dropped, others))
        heard = model.prompt(other.text)
        if is_posture(phrase) and not is_pose(heard.refused or heard.kind):
            continue
        if heard.share < SURE and not (heard.refused and is_pose(heard.refused)):
            continue  # "walk carrying a box" is no punch; of a pose that is not done, "with your head tilted", is told
        if heard.unoffered is not None:
            clause = replace(clause, notes=(*clause.notes, f"{phrase!r} is left out: {heard.unoffered}"))
            continue
        if limbs(heard.kind) == frozenset(["leg"]) and not _is_walk(other.text):
            continue  # "wave while telling him to walk"
        both = _both(clause, replace(other, joint=clause.joint), model)
        if both is not None:
            said = f"{clause.said} {phrase}" if phrase not in clause.said else clause.said
            clause = _told(replace(both, said=said, dropped=tuple(one for one in both.dropped if one != phrase)))
    return clause


def _is_walk(text: str) -> bool:
    """Whether words ask the robot itself to walk, turn or squat: they begin with that, and name nobody else."""
    known, words = vocabulary(), text.split()
    own = known.words("paths") | known.words("walk_verbs") | known.words("turn_verbs") | known.words("single_motions")
    return words[0] in own and not known.words("other_people") & set(words)


def _both(one: Clause, other: Clause, model: Model) -> Clause | None:
    """Two requests as one; None where they do not fit together."""
    kinds = [_kind(clause, model) for clause in (one, other)]
    if None in kinds or one.beside is not None or other.beside is not None:
        return None
    first, second = map(str, kinds)
    if vocabulary().words("stop_verbs") & {stem(word) for clause in (one, other) for word in clause.text.split()}:
        return None  # "stop walking while waving"
    if STAND in (first, second):
        # "Stand still while waving"; the end of the stand is that of both.
        gesture, stand = (other, one) if first == STAND else (one, other)
        if not fits_beside(second if first == STAND else first, STAND) or (stand.amount and gesture.amount):
            return None
        return replace(_joined(gesture, stand), amount=gesture.amount or stand.amount, still=True)
    if fits_beside(second, first):
        return _beside(one, other, model)
    return _beside(other, one, model) if fits_beside(first, second) else None


def _kind(clause: Clause, model: Model) -> str | None:
    """Kind of motion that a request asks for; None where it asks for none that is known."""
    if clause.asks is not Asks.MOTION or clause.forbidden or clause.refusal is not None or not clause.text:
        return None
    heard = model.prompt(clause.text)
    known = heard.known and heard.warning is None
    return heard.kind if known and not (heard.kind == STAND and is_no_stand(clause.text)) else None


def _beside(main: Clause, gesture: Clause, model: Model) -> Clause:
    """A motion with a gesture that lasts as long: where only the gesture has an end, for the time that it takes."""
    joined = replace(_joined(main, gesture), beside=without_amount(gesture))
    if gesture.amount is None and not gesture.counted:
        return joined
    rhythm = model.rhythm(Condition(gesture.text, tempo=gesture.speed))
    each = GESTURE_S * gesture.times if rhythm is None else rhythm.seconds(gesture.times)
    amount = gesture.amount or Amount(each, "time", amount_of(gesture))
    if main.amount is None and not main.counted and amount.quantity in ("length", "steps", "angle"):
        return replace(joined, amount=amount)  # "walk while waving for two metres"
    if main.amount is not None or main.counted or amount.quantity != "time":
        return replace(joined, dropped=(*joined.dropped, f"{gesture.text} {amount.said}"))
    note = () if gesture.amount is not None else (f"{amount.said!r} is taken as {amount.value:.3g} s of both",)
    return replace(joined, amount=amount, notes=(*joined.notes, *note))


def _joined(main: Clause, other: Clause) -> Clause:
    """The first request with what is told of both."""
    dropped, notes = (*main.dropped, *other.dropped), (*main.notes, *other.notes)
    return replace(main, said=f"{main.said} {other.said}", dropped=dropped, notes=notes)
