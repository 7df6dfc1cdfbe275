"""`clause_of`: one part of a sentence to a request with its amount."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

from flexmotion.text.amounts import Amount, Bare, Token, is_mark
from flexmotion.text.clause import NO_KNOWN_WORD, ONE_SPEED, PER_TIME, SAY_A_SPEED, UNITS, Asks, Clause
from flexmotion.text.clause_amounts import (
    amounts_of,
    counts_nothing,
    degree_of,
    further_times,
    is_count,
    little_of,
    signed,
    speed_of,
    unread_number,
)
from flexmotion.text.no_walks import STAND_STILL, stand_note, unknown_way
from flexmotion.text.paces import Rate, Speed
from flexmotion.text.phrases import STAND
from flexmotion.text.postures import without_posture
from flexmotion.text.prompt_reader import FORBIDS_NOTHING, WITHOUT_TURNING
from flexmotion.text.refusals import condition_of, lowered_meanwhile, needs_head, refusal_of, unbounded
from flexmotion.text.relative import asked_change, change_factor, repeated_motion
from flexmotion.text.sentence_parts import NEGATES, Part
from flexmotion.text.shaping import destinations, has_verb, shaped
from flexmotion.text.sides import sides
from flexmotion.text.vocabulary import vocabulary
from flexmotion.text.wording import plain, stem, stripped, taught, taught_words

UNSEEN = "the robot does not know where you are"
"""Of a walk or a turn to who says it."""


def clause_of(part: Part, forbidding: bool) -> Clause | None:
    """The request of one part; None where it asks for nothing."""
    known = vocabulary()
    tokens = [token for token in part.tokens if not is_mark(token)]
    said = plain(tokens)
    dropped, notes = list(part.dropped), list[str]()
    tokens = stripped(tokens)
    words = [token for token in tokens if isinstance(token, str)]
    sentence = " ".join(words)
    rates, tokens = [one for one in tokens if isinstance(one, Rate)], [t for t in tokens if not isinstance(t, Rate)]
    if len(rates) == 1 and not tokens and not forbidding:
        # `completed` takes the motion from the request before.
        return Clause(said, "", rate=rates[0], refusal=_no_speed(rates) or SAY_A_SPEED, joint=part.joint)
    if len(rates) > 1 or (rates and (forbidding or not tokens or _forbids(words))):
        return Clause(said, sentence, refusal=SAY_A_SPEED)
    if forbidding or _forbids(words):
        rest = plain(stripped([*NEGATES.sub(" ", sentence).split()]))
        return Clause(said, rest, forbidden=True, dropped=tuple(dropped))
    if part.refusal is None and (note := stand_note(tokens)) is not None:
        return Clause(said, STAND_STILL, dropped=tuple(dropped), notes=(note,), joint=part.joint)
    plain_stop = taught().get(plain(tokens)) == STAND
    stops = words[:1] and words[0] in known.words("stop_verbs")
    refusal = part.refusal or _no_speed([*rates, *tokens]) or refusal_of(words) or lowered_meanwhile(words, dropped)
    condition = condition_of(words)
    untold = condition is not None and condition not in known.words("allowed_conditions")
    if stops and part.refusal is None and (refusal is not None or untold):
        # "stop wherever you are": whatever else is said, the robot can stop.
        rest = " ".join([*words[1:], *(rate.said for rate in rates)])
        return Clause(said, words[0], dropped=(*dropped, rest))
    if refusal is not None:
        return Clause(said, sentence, refusal=refusal, dropped=tuple(dropped))
    if not tokens:
        return Clause(said, "", dropped=tuple(dropped), refusal="nothing else is asked for") if dropped else None
    if _unknown(words, part.joint):
        return Clause(said, sentence, refusal=NO_KNOWN_WORD)
    head = needs_head([token for token in without_posture(tokens)[0] if isinstance(token, str)])
    until_told = condition is not None and not untold
    if condition is not None and not plain_stop:
        dropped += [] if until_told else [condition]
        tokens = _without_tail(tokens, condition.split()[0])
    if (times := further_times(tokens)) is not None:
        return Clause(said, "", Asks.AGAIN, None, times, True, dropped=tuple(dropped), more=True)
    if (again := _repeats(tokens)) is not None:
        return Clause(said, sentence, refusal=f"{again!r}: nothing is repeated by the clock; say how often")
    if (sign := signed(tokens)) is not None:
        return Clause(said, sentence, refusal=f"{sign!r}: expected more than 0")
    tokens, posture = without_posture(tokens)
    dropped += [] if posture is None else [posture]
    uncountable = next((t for t in tokens if isinstance(t, Amount) and not is_count(t)), None)
    if uncountable is not None:
        return Clause(said, sentence, refusal=f"{uncountable.said!r}: expected a whole number, 1 or more")
    amount, times, counted, tokens, extra = amounts_of(tokens)
    dropped += extra
    if head and amount is not None and amount.quantity == "angle":
        dropped.append(amount.said)  # a head that turns in words turns as far as it does
        amount = None
    if amount is None and not counted:
        amount, tokens = little_of(tokens)
    if amount is None and not counted and posture is not None and tokens == ["step"]:
        amount = Amount(1.0, "steps", "step")  # "step with your left foot"
    if amount is not None and amount.rough:
        notes.append(f"{amount.said!r} is taken as {amount}")
    bare = any(isinstance(token, Bare) or (isinstance(token, str) and token.isdigit()) for token in tokens)
    if bare or counts_nothing(tokens):
        return Clause(
            said, plain(tokens), refusal=f"{_unitless(tokens)!r}: the number has no unit that is known; {UNITS}"
        )
    if (unread := unread_number(tokens)) is not None:
        return Clause(said, plain(tokens), refusal=unread)
    asks, factor = _asked(said, tokens, amount, part.joint, counted)
    if asks is Asks.MOTION and amount is None and (named := repeated_motion(plain(tokens))) is not None:
        return Clause(said, stem(named), Asks.AGAIN, None, times, counted, dropped=tuple(dropped), notes=tuple(notes))
    if asks is Asks.CONTINUE and rates:
        return Clause(said, "", amount=amount, rate=rates[0], refusal=SAY_A_SPEED, joint=part.joint)
    if asks is not Asks.MOTION and rates:
        return Clause(said, "", refusal=SAY_A_SPEED)
    if asks in (Asks.FASTER, Asks.SLOWER) and (amount is not None or counted):
        return Clause(said, "", refusal="a change of speed has no length, time or count of its own")
    if asks is not Asks.MOTION:
        once = asks is Asks.AGAIN and plain(tokens) in ("", "more", *known.words("once_more"))
        return Clause(
            said, "", asks, amount, times, counted, factor, dropped=tuple(dropped), notes=tuple(notes), more=once
        )
    if (other := unknown_way(words)) is not None:
        return Clause(said, plain(tokens), refusal=other)
    if amount is None and words[:1] and words[0] in known.words("turn_verbs") and "by" in words and not head:
        return Clause(said, plain(tokens), refusal="the amount is not understood")
    speed, manner, tokens = speed_of(tokens)
    words = [token for token in tokens if isinstance(token, str)]
    own, degree = list(words), degree_of(words)
    words = [word for word in words if word not in ("again",)] if len(words) > 1 else words
    things: dict[str, str] = known.table["things"]
    words = [part for word in words for part in (things[word].split() if counted and word in things else [word])]
    words, amount, refusal = shaped(words, amount, times, counted)
    if amount is not None and amount.said.endswith("times around"):
        times, counted = 1, False
    if counted and amount is None and words[:1] in (["step"], ["sidestep"]):
        amount, times, counted = Amount(float(times), "steps", f"{times} times"), 1, False
    moves_head = head and plain(tokens) in taught()  # "move your head up and down"
    places = [] if moves_head else destinations(words)
    if _comes(own) and own[0] in known.words("turn_verbs"):
        told = amount is not None or (sides(" ".join(own)) and "side" not in own)
        notes.append(f"{UNSEEN}: it turns {'to the side that is said' if amount is None else amount}")
        refusal = refusal or (None if told else f"{UNSEEN}; say for example 'turn left 90 degrees'")
    elif known.words("persons") & set(own) and _comes(own[:1]):
        refusal = refusal or f"{' '.join(own[1:])!r}: the robot does not see where that is"  # "approach the man"
    elif own[1:2] == ["back"] and _comes(own[:1]):
        notes.append(f"{UNSEEN}: it walks straight back")
    elif _comes(own):
        notes.append(f"{UNSEEN}: it walks straight ahead")
    if own[:3] == ["turn", "to", "face"] and words != own:
        notes.append(f"taken as {' '.join(words)!r}: the robot knows no places")
    if amount is None:
        ends = None if until_told or plain_stop else condition
        refusal = refusal or unbounded(ends, places[0] if places else None)
    more = amount is not None and not own and bool(known.words("further") & set(said.split()))
    return Clause(
        said,
        " ".join(words),
        Asks.CONTINUE if more else Asks.MOTION,
        amount,
        times,
        counted,
        speed,
        rates[0] if rates else None,
        refusal=None if more else refusal,
        dropped=(*dropped, *places),
        notes=tuple(notes),
        manner=manner,
        degree=degree,
        needs_head=head,
        until_told=until_told,
        more=more,
        verbless=not has_verb(own),
    )


def _unitless(tokens: Sequence[Token]) -> str:
    """The number that counts nothing known, with the word behind it: "45 degres"."""
    numbers = vocabulary().table["numbers"]
    counts = (
        place for place, one in enumerate(tokens) if isinstance(one, Bare) or str(one).isdigit() or one in numbers
    )
    first = next(counts, 0)
    return plain(list(tokens[first : first + 2]))


def _comes(words: list[str]) -> bool:
    """Whether a walk is one to who says it: "come here", "walk towards me"."""
    known = vocabulary()
    if words[:1] in (["come"], ["approach"]):
        return True
    walks = bool(words) and words[0] in known.words("walk_verbs") | known.words("paths")
    toward = zip(words, words[1:], strict=False)
    return walks and any(one in ("to", "towards", "toward", "on") and who in ("me", "us") for one, who in toward)


def _no_speed(tokens: Sequence[Token]) -> str | None:
    """Why words are no speed although they begin as one: "0.3 to 0.5 m/s", "2 metres per 5 seconds"; None: none do."""
    vague = next((token for token in tokens if isinstance(token, Rate) and token.vague), None)
    if vague is not None:
        return f"{vague.said!r}: {ONE_SPEED}"
    times = vocabulary().table["units"]["time"]
    for place, token in enumerate(tokens):
        before, after = list(tokens[max(place - 1, 0) : place]), list(tokens[place + 1 : place + 2])
        counts = any(not isinstance(one, str) for one in (*before, *after)) or (after and after[0] in times)
        # A mark of a unit is left over where its time is none that a speed is of: "m/day".
        if isinstance(token, str) and token.startswith(("pi/", "/pi", "+pi")):
            return f"{token!r}: expected a multiple of pi, or pi by a number above 0, as in 'turn left pi/2 radians'"
        if isinstance(token, str) and ("/" in token or (token == "per" and counts)):
            return f"{plain([*before, token, *(after if token == 'per' else [])])!r}: {PER_TIME}"
    return None


def _repeats(tokens: list[Token]) -> str | None:
    """What says that a request is repeated by the clock: "every five seconds"."""
    for token, after in pairwise(tokens):
        if token in ("every", "each") and isinstance(after, Amount):
            return f"{token} {after.said}"
    return None


def _forbids(words: list[str]) -> bool:
    """Whether a part says what not to do."""
    rest = FORBIDS_NOTHING.sub(" ", " ".join(words))
    turns = words[:1] and words[0] in vocabulary().words("turn_verbs")
    return NEGATES.search(rest if turns else WITHOUT_TURNING.sub(" ", rest)) is not None


def _unknown(words: list[str], joint: str) -> bool:
    """Whether no word of a part is known."""
    known = vocabulary()
    if not words or any(word in taught_words() or word in known.verbs for word in words):
        return False
    asked = asked_change(" ".join(words), None, joint) is Asks.MOTION
    return asked and not set(words) <= known.words("directions") | known.words("hedges") | known.words("refers")


def _asked(said: str, tokens: list[Token], amount: Amount | None, joint: str, counted: bool) -> tuple[Asks, float]:
    """What a part asks for, and the factor of a change of speed."""
    sentence = plain([token for token in tokens if not isinstance(token, Speed)])
    speeds = [token for token in tokens if isinstance(token, Speed)]
    asks = asked_change(sentence, amount, joint)
    if amount is not None and amount.quantity == "time" and sentence in vocabulary().words("hold"):
        asks = Asks.CONTINUE
    if counted and amount is None and sentence in ("", "more", *vocabulary().words("continue")):
        asks = Asks.AGAIN  # "two more times", "do that three times"
    alone = not sentence or sentence in vocabulary().words("amplifiers")
    if speeds and (alone or asks in (Asks.FASTER, Asks.SLOWER, Asks.CONTINUE)):
        factor = math.prod(token.factor for token in speeds)
        return (Asks.FASTER if factor >= 1.0 else Asks.SLOWER), factor
    return asks, change_factor(said, asks) if asks in (Asks.FASTER, Asks.SLOWER) else 1.0


def _without_tail(tokens: list[Token], word: str) -> list[Token]:
    return tokens[: tokens.index(word)] if word in tokens else tokens
