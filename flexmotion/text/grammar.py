"""`parse`: a sentence to the requests in it, in their order, each with its amount; before any model hears it.

The grammar separates what a listener cannot: several requests in one sentence, how much of each, requests about the
motion that is under way ("faster", "again"), and looking, for which there is no motion. The words of each request are
left to the listener. A sentence in which the grammar finds nothing is one request with the words as given.
"""

from __future__ import annotations

from dataclasses import replace

from flexmotion.text.amounts import tokens_of
from flexmotion.text.clauses import Asks, Clause, clause_of
from flexmotion.text.phrases import STAND
from flexmotion.text.sentence_parts import Part, parts_of
from flexmotion.text.wording import plain, taught


def parse(sentence: str) -> tuple[Clause, ...]:
    """The requests of a sentence, at least one, in the order in which they are to be done."""
    tokens = tokens_of(sentence)
    words = plain(tokens)
    kind = taught().get(words)
    if kind == STAND:
        return (Clause(sentence, sentence),)  # "look out", "never mind the walking, quit it"
    parts = [Part(tokens)] if kind is not None else parts_of(tokens)
    clauses: list[Clause] = []
    forbidding = False
    for number, part in enumerate(parts):
        # "don't walk or wave" and "don't walk, turn or wave" forbid all; "don't walk, wave" and "don't walk then wave"
        # only the first.
        joint = next((later.joint for later in parts[number:] if later.joint != ","), "then")
        forbidding = forbidding and (part.joint == "and" or joint in ("or", "nor"))
        clause = clause_of(part, forbidding)
        if clause is None:
            continue
        forbidding = clause.forbidden
        clauses.append(replace(clause, joint=part.joint if clauses else ","))
    if not clauses:
        return (Clause(sentence, sentence),)
    if len(clauses) == 1 and clauses[0].said == words and _is_plain(clauses[0]):
        # The listener gets the sentence as it was given.
        return (replace(clauses[0], said=sentence, text=sentence),)
    return tuple(clauses)


def _is_plain(clause: Clause) -> bool:
    """Whether the grammar has nothing to add to what a listener hears in the whole sentence."""
    return clause.asks is Asks.MOTION and clause.amount is None and clause.speed == 1.0 and not clause.counted


def whole(sentence: str) -> Clause | None:
    """The sentence as one request, joints or not; None where it asks for nothing."""
    tokens = tokens_of(sentence)
    clause = clause_of(Part(tokens), False)
    if clause is not None and _is_plain(clause) and not clause.dropped:
        return replace(clause, said=sentence, text=sentence)
    return clause
