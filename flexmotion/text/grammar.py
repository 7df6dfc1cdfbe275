"""`parse`: a sentence to the requests in it, in their order, each with its amount; before any model hears it.

The grammar separates what a listener cannot: several requests in one sentence, how much of each, requests about the
motion that is under way ("faster", "again"), and what only a motion of the head can do. The words of each request, and
with them its manner, are left to the listener. A sentence in which the grammar finds nothing is one request with the
words as given.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from flexmotion.text.amounts import Amount, Token, is_mark, tokens_of
from flexmotion.text.clause import NO_KNOWN_WORD, Asks, Clause
from flexmotion.text.clause_amounts import speed_of
from flexmotion.text.clauses import clause_of
from flexmotion.text.ellipsis import completed, corrected
from flexmotion.text.manner_phrases import MannerPhrase, manner_phrases
from flexmotion.text.no_walks import STAND_STILL, stand_note
from flexmotion.text.paces import Rate
from flexmotion.text.phrases import STAND
from flexmotion.text.prompt_reader import WITHOUT_TURNING
from flexmotion.text.questions import QUESTION, REPORT, is_question, is_report, without_report
from flexmotion.text.rewording import reworded
from flexmotion.text.sentence_parts import Part, parts_of
from flexmotion.text.vocabulary import vocabulary
from flexmotion.text.wording import STAND_IN, plain, stripped, taught


def parse(sentence: str) -> tuple[Clause, ...]:
    """The requests of a sentence, at least one, in the order in which they are to be done."""
    sentence = reworded(sentence)
    stands, note = taught().get(plain(tokens_of(sentence))) == STAND, stand_note(tokens_of(sentence))
    if stands or note is not None:
        # "never mind the walking, quit it"; "careful, a step"
        return (Clause(sentence, sentence if stands else STAND_STILL, notes=() if note is None else (note,)),)
    if is_question(sentence) and plain(tokens_of(sentence)) not in taught():
        return (Clause(sentence, sentence, refusal=QUESTION),)
    sentence = without_report(sentence)
    if is_report(sentence) and plain(tokens_of(sentence)) not in taught():
        return (Clause(sentence, sentence, refusal=REPORT),)
    # "Like a ninety year old" is no amount, "without confidence" no prohibition.
    phrases = [phrase for phrase in manner_phrases(sentence) if " " in phrase.text]
    found = _parsed(_with_names(sentence, phrases))
    return tuple(_with_manner(_with_phrases(clause, phrases)) for clause in found)


def _with_names(sentence: str, phrases: Sequence[MannerPhrase]) -> str:
    """The sentence with a word in the place of each phrase, and a comma behind those that something else follows."""
    for number, phrase in reversed(list(enumerate(phrases))):
        rest = sentence[phrase.end :]
        # "Walk without turning" is one request.
        comma = "," if phrase.cut and WITHOUT_TURNING.match(rest.lstrip()) is None else ""
        sentence = f"{sentence[: phrase.start]}{_name(number)}{comma}{rest}"
    return sentence


def _with_phrases(clause: Clause, phrases: Sequence[MannerPhrase]) -> Clause:
    """The clause with the phrases in place of their words."""

    def told(text: str) -> str:
        for number, phrase in enumerate(phrases):
            text = text.replace(_name(number), phrase.text)
        return text

    dropped = tuple(told(part) for part in clause.dropped)
    refusal = None if clause.refusal is None else told(clause.refusal)
    return replace(clause, said=told(clause.said), text=told(clause.text), refusal=refusal, dropped=dropped)


def _with_manner(clause: Clause) -> Clause:
    """The clause with the manner in its text also where the grammar has put words of its own ("turn to the left")."""
    if clause.asks is not Asks.MOTION or clause.forbidden or not clause.text:
        return clause
    lost = [one.text for one in manner_phrases(clause.said) if one.text not in clause.text.lower()]
    lost = [text for text in lost if not any(text in part for part in clause.dropped)]
    return replace(clause, text=" ".join([clause.text, *lost])) if lost else clause


def _name(number: int) -> str:
    """A word that means nothing, for phrase `number`."""
    return STAND_IN + "x" * number + "y"


def _parsed(sentence: str) -> tuple[Clause, ...]:
    tokens = tokens_of(sentence)
    words = plain(tokens)
    kind = taught().get(words)
    parts = [Part(tokens)] if kind is not None else _with_adverbs(parts_of(tokens))
    clauses: list[Clause] = []
    names: list[str] = []
    forbidding = False
    for number, part in enumerate(parts):
        # "don't walk or wave" and "don't walk, turn or wave" forbid all; "don't walk, wave" and "don't walk then wave"
        # only the first.
        joint = next((later.joint for later in parts[number:] if later.joint != ","), "then")
        forbidding = forbidding and (part.joint == "and" or joint in ("or", "nor"))
        clause = clause_of(part, forbidding)
        if clause is None:
            continue
        if part.corrects is not None and (wrong := clause_of(Part(part.corrects), False)) is not None:
            clause = corrected(clause, wrong)
        called = number == 0 and [later.joint for later in parts[1:2]] == [","] and part.joint != "after"
        if called and clause.refusal == NO_KNOWN_WORD and len(clause.said.split()) == 1:
            names.append(f"{clause.said!r} is taken for a name")
            continue
        own = [token for token in stripped(part.tokens) if isinstance(token, str) and not is_mark(token)]
        clause = completed(clause, own, clauses[-1] if clauses else None, goes_on=part.tokens[:1] == ["and"])
        forbidding = clause.forbidden
        if clauses and clause.asks is clauses[-1].asks and clause.asks in (Asks.FASTER, Asks.SLOWER):
            clauses.pop()  # "that's too fast, slow down a bit" asks once
        if part.joint == "or" and clauses and not (clause.forbidden or clauses[-1].forbidden):
            clause = replace(clause, refusal=clause.refusal or f"say which: {clauses[-1].said!r} or {clause.said!r}")
        clauses.append(replace(clause, joint=part.joint if clauses else ","))
    if not clauses:
        return (Clause(sentence, sentence),)
    if len(clauses) > 1 and (count := _count_behind(tokens)) is not None and kind is None:
        clauses[-1] = _counted_last(clauses[-1], count)
    clauses[0] = replace(clauses[0], notes=(*names, *clauses[0].notes))
    if len(clauses) == 1 and clauses[0].said == words and _is_plain(clauses[0]) and not clauses[0].dropped:
        # The listener gets the sentence as it was given.
        return (replace(clauses[0], said=sentence, text=sentence),)
    return tuple(clauses)


def _count_behind(tokens: list[Token]) -> str | None:
    """How often, behind the last comma of a sentence and alone ("…, twice"); None where nothing such ends it."""
    *rest, last = stripped(tokens) or [""]
    alone = isinstance(last, Amount) and last.quantity == "times" and rest[-1:] == [","]
    return plain([last]) if alone else None


def _counted_last(last: Clause, count: str) -> Clause:
    """The last request with the count behind it, where that may be its own: "bow, then clap, three times"."""
    feet = vocabulary().words("walk_verbs") | vocabulary().words("turn_verbs")
    # Walks and turns are counted together: "walk a metre, then turn left, four times" is a square.
    if last.joint == "then" and last.amount is None and not feet & set(last.text.split()):
        return replace(last, notes=(*last.notes, f"{count!r} is taken as of {last.text!r} alone"))
    return replace(last, refusal=f"{count!r}: all of it or the last? say it in front of each")


def _with_adverbs(parts: list[Part]) -> list[Part]:
    """The parts, an opening adverb with the request that it is of: "at half the speed, walk forward"."""
    if len(parts) < 2 or parts[1].joint != "," or parts[0].dropped:
        return parts
    if vocabulary().words("comparatives") & {token for token in parts[0].tokens if isinstance(token, str)}:
        return parts  # "slower, hands up"
    tokens, (speed, _, rest) = parts[1].tokens, speed_of(stripped(parts[0].tokens))
    says_speed = speed != 1.0 or any(isinstance(token, Rate) for token in rest)
    if any(not isinstance(token, Rate) for token in rest) or not says_speed or clause_of(parts[1], False) is None:
        return parts
    return [replace(parts[1], tokens=[*tokens, *stripped(parts[0].tokens)], joint=parts[0].joint), *parts[2:]]


def _is_plain(clause: Clause) -> bool:
    """Whether the grammar has nothing to add to what a listener hears in the whole sentence."""
    counts = clause.amount is not None or clause.counted or clause.until_told or bool(clause.notes)
    return clause.asks is Asks.MOTION and clause.speed == 1.0 and clause.rate is None and not counts


def whole(sentence: str) -> Clause | None:
    """The sentence as one request, joints or not; None where it asks for nothing."""
    tokens = tokens_of(sentence)
    clause = clause_of(Part(tokens), False)
    if clause is not None and _is_plain(clause) and not clause.dropped:
        return replace(clause, said=sentence, text=sentence)
    return clause
