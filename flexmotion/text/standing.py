"""`asked_stand`: whether a sentence holds a request for a stand, where no model listens to it."""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import lru_cache

from flexmotion.text.alarm import is_alarm
from flexmotion.text.amounts import tokens_of
from flexmotion.text.clause import Asks, Clause
from flexmotion.text.grammar import parse
from flexmotion.text.no_walks import stand_note
from flexmotion.text.phrases import STAND, wordings
from flexmotion.text.prompt_reader import FORBIDS_NOTHING
from flexmotion.text.questions import QUESTION, REPORT
from flexmotion.text.sentence_parts import NEGATES
from flexmotion.text.vocabulary import vocabulary
from flexmotion.text.wording import plain, stripped, taught

_STILL = re.compile(r"\b(?:stand|stay|hold|keep|be|remain|standing|staying|holding|keeping) (?:\w+ly |very )?still\b")
"""A stand wherever it is said: "I told you to stand still"."""


@dataclass(frozen=True)
class Stand:
    """A request for a stand.

    Attributes:
        dropped: what the sentence asks for beside it, which is not done.
        notes: what the words do not do ("power off" switches no torque off).
    """

    dropped: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()


@lru_cache(maxsize=64)  # asked of one sentence before each plan
def asked_stand(sentence: str) -> Stand | None:
    """The stand that a sentence asks for, or by which a prohibition in it is obeyed; None where it asks for none.

    In doubt it is one. A model run stands on words that it refuses; where no model listens the robot would move on.
    """
    if is_alarm(sentence):
        return Stand()
    if _is_stand(plain(stripped(tokens_of(sentence)))):
        note = stand_note(tokens_of(sentence))
        return Stand(notes=() if note is None else (note,))
    clauses = parse(sentence)
    stops = [_stops(clause) for clause in clauses]
    if not any(stops):
        return None
    beside = tuple(clause.said for clause, stop in zip(clauses, stops, strict=True) if not (stop or clause.forbidden))
    notes = (note for clause, stop in zip(clauses, stops, strict=True) if stop for note in clause.notes)
    return Stand(beside, tuple(dict.fromkeys(notes)))


def _stops(clause: Clause) -> bool:
    """Whether one request asks for a stand, or forbids anything but one."""
    said = plain(tokens_of(clause.said))
    if clause.forbidden or (clause.refusal not in (None, QUESTION, REPORT) and _negates(said)):
        return said.startswith("no ") or not _holds_stop(NEGATES.sub(" ", said))
    if clause.asks is not Asks.MOTION:
        return False  # "don't stop" goes on
    text = plain(stripped(tokens_of(clause.text)))
    return _is_stand(text) or _holds_stop(FORBIDS_NOTHING.sub(" ", clause.text.lower())) or _holds_refused(clause, said)


def _holds_refused(clause: Clause, said: str) -> bool:
    """Whether a stop is among words that the grammar has taken for something that cannot be done."""
    return clause.refusal is not None and _holds_stop(FORBIDS_NOTHING.sub(" ", said))


def _negates(said: str) -> bool:
    return NEGATES.search(FORBIDS_NOTHING.sub(" ", said)) is not None


def _is_stand(words: str) -> bool:
    """Whether a whole request, without fillers, asks for nothing but a stand."""
    if words in wordings(STAND) or any(pattern.fullmatch(words) for pattern in _halts()):
        return True
    names_limb = bool(vocabulary().words("limbs") & set(words.split()))
    return taught().get(words) == STAND and not names_limb  # "lower your arms" is taught as a stand


def _holds_stop(words: str) -> bool:
    said = re.findall(r"[\w']+", words)
    opens = bool(said) and said[0] in vocabulary().words("halting_openers")
    return opens or bool(vocabulary().words("halting") & set(said)) or _STILL.search(words) is not None


@lru_cache
def _halts() -> tuple[re.Pattern[str], ...]:
    return tuple(re.compile(pattern) for pattern in vocabulary().table["halts"])
