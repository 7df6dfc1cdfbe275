"""`restriction_phrase`: sentences that only restrict the robot, and those that let go again.

"Keep your left foot down", "no more than 1 newton metre at the knee", "loosen your arms", "you may lift your feet
again". A sentence that says anything else beside, "keep your feet on the ground and wave", is left to the grammar.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Literal

from flexmotion.text.numbers import number_at
from flexmotion.text.part_phrases import POLITE

Foot = Literal["left", "right", "both"]
Limb = Literal["left arm", "right arm", "both arms", "head"]

_UNIT = re.compile(r"\b(?:newton[\s-]?met(?:re|er)s?|n\s?[·*⋅]?\s?m)\b")
_MINUS = re.compile(r"(?<![\w.])[-\u2212\u2013]\s?(?=[\w.])")
_WORD = re.compile(r"\d*\.?\d+|[a-z]+")

LEAST_NM = 0.01
"""Least torque cap [N·m]."""
OWN = r"(?:your|ur|the|its|his|her)"
BOTH_FEET = rf"(?:both\s(?:of\s)?(?:{OWN}\s)?|{OWN}\s(?:both\s)?)(?:feet|legs)"
"""Words for whose a part of the body is, and for both feet, as patterns."""
_ONE = rf"(?:{OWN}\s)?(?P<side>left|right)\s(?:foot|leg)"
_FOOT = rf"(?:{_ONE}|{BOTH_FEET})"
_ON = r"on\s(?:the\s)?(?:ground|floor)"
_DOWN = rf"(?:down|planted|still|(?:(?:down|flat|planted)\s)?{_ON})"
_OFF = r"(?:\s(?:up|off\s(?:the\s)?(?:ground|floor)))?"
_NEVER = r"(?:do\snot|don\st|dont|never)"
_LEAVES = r"(?:leave|come\soff|lift\soff)\s(?:the\s)?(?:ground|floor)"
_KEPT = tuple(
    re.compile(pattern)
    for pattern in (
        rf"(?:keep|leave|hold)\s{_FOOT}\s{_DOWN}",
        rf"(?:make\ssure\s(?:that\s)?)?{_FOOT}\s(?:(?:must|should|has\sto|have\sto)\s)?(?:stays?|remains?)\s{_DOWN}",
        rf"plant\s{_FOOT}(?:\sdown)?(?:\s{_ON})?",
        rf"{_NEVER}\s(?:lift|raise)\s(?:up\s)?{_FOOT}{_OFF}",
        rf"{_NEVER}\smove\s{_ONE}",  # "don't move your feet" asks for a stand, and holds nothing
        rf"{_NEVER}\slet\s{_FOOT}\s{_LEAVES}",
        rf"{_FOOT}\s(?:must|should|may)\s(?:not|never)\s{_LEAVES}",
    )
)
_FREE = (
    re.compile(rf"you\s(?:may|can)\s(?:lift|raise|move)\s{_FOOT}{_OFF}(?:\sagain)?"),
    re.compile(rf"let\s{_FOOT}\sgo(?:\sagain)?"),
    re.compile(rf"(?:let\sgo\sof|release)\s{_FOOT}(?:\sagain)?"),
)

_JOINTS = ("hip", "knee", "ankle", "shoulder", "elbow", "wrist", "neck")
_PLURALS = {"hips": "hip", "knees": "knee", "ankles": "ankle", "shoulders": "shoulder", "elbows": "elbow"}
_PLURALS |= {"wrists": "wrist"}
_JOINT = rf"(?:{OWN}\s)?(?:both\s)?(?:{OWN}\s)?(?P<joint>(?:(?:left|right)\s)?(?:{'|'.join([*_PLURALS, *_JOINTS])}))"
_NUMBER = r"(?P<number>[\w. ]+?)\snm"
_MOST = r"(?:use\s|put\s|apply\s)?(?:no\smore\sthan|at\smost|a\smaximum\sof|not\smore\sthan)"
_AT_MOST = re.compile(rf"{_MOST}\s{_NUMBER}\s(?:of\storque\s)?(?:at|in|on|for|with|from)\s{_JOINT}")
_TO_LIMIT = r"(?:limit|cap|restrict)\s(?:the\storque\s(?:of|at|in|on)\s)?"
_LIMIT = re.compile(rf"{_TO_LIMIT}{_JOINT}(?:\storque)?\s(?:to|at)\s{_NUMBER}")
_NO_LIMIT = re.compile(
    rf"(?:remove|take\soff|lift|release|end|drop)\s(?:the\s)?(?:torque\s)?(?:limit|cap)\s(?:of|at|in|on|for|from)\s{_JOINT}"
)

_ARMS = r"(?:your|the|its)\s(?:both\s)?arms|both\s(?:of\s)?(?:(?:your|the|its)\s)?arms"
_LIMB = rf"(?:(?:(?:your|the|its)\s)?(?P<limb>(?:left|right)\sarm|head|neck)|{_ARMS})"
_STATE = r"(?:make|let|keep|hold|leave|have)"
_TENSIONS = (
    (re.compile(rf"(?:soften|loosen|slacken)(?:\sup)?\s{_LIMB}"), 0.0),
    (re.compile(rf"{_STATE}\s{_LIMB}\s(?:be\s|go\s)?(?:soft|loose|slack)"), 0.0),
    (re.compile(rf"(?:stiffen|tense)(?:\sup)?\s{_LIMB}"), 1.0),
    (re.compile(rf"{_STATE}\s{_LIMB}\s(?:be\s|go\s)?(?:stiff|tense|rigid|firm)"), 1.0),
)


@dataclass(frozen=True)
class RestrictionPhrase:
    """What a sentence restricts, or lets go.

    Attributes:
        foot: that stays down, or is let go; None: the sentence is about a torque.
        joint: whose torque is capped, or let go: `knee`, `left knee`; None: the sentence is about something else.
        limit: of the torque [N·m]; None: of something else, or let go.
        limb: that is to be soft or stiff; None: the sentence is about something else.
        tension: of the limb, 0 soft to 1 stiff; None: of something else.
        lets_go: whether the restriction is to end.
    """

    foot: Foot | None = None
    joint: str | None = None
    limit: float | None = None
    limb: Limb | None = None
    tension: float | None = None
    lets_go: bool = False


def restriction_phrase(sentence: str) -> RestrictionPhrase | None:
    """What a whole sentence restricts or lets go; None where it asks for anything else."""
    words = restriction_words(sentence)
    for pattern in (*_KEPT, *_FREE):
        if (found := pattern.fullmatch(words)) is not None:
            lets_go = pattern in _FREE
            return RestrictionPhrase(foot=_foot(found["side"]), lets_go=lets_go)
    for pattern, tension in _TENSIONS:
        if (found := pattern.fullmatch(words)) is not None:
            return RestrictionPhrase(limb=_limb(found["limb"]), tension=tension)
    if (found := _NO_LIMIT.fullmatch(words)) is not None:
        return RestrictionPhrase(joint=_joint(found["joint"]), lets_go=True)
    found = _AT_MOST.fullmatch(words) or _LIMIT.fullmatch(words)
    limit = None if found is None else _number(found["number"].split())
    if found is None or limit is None or limit < LEAST_NM:
        return None
    return RestrictionPhrase(joint=_joint(found["joint"]), limit=limit)


def restriction_words(sentence: str) -> str:
    """Words and numbers of a sentence in lower case, "nm" for the unit of a torque, "minus" for its sign."""
    text = _MINUS.sub(" minus ", _UNIT.sub(" nm ", sentence.lower()))
    return " ".join(POLITE.sub(" ", " ".join(_WORD.findall(text))).split())


def _foot(side: str | None) -> Foot:
    return "left" if side == "left" else "right" if side == "right" else "both"


def _limb(words: str | None) -> Limb:
    match words:
        case "left arm" | "right arm":
            return words
        case "head" | "neck":
            return "head"
        case _:
            return "both arms"


def _joint(words: str) -> str:
    """The name of the body's joint, in the singular."""
    side, _, part = words.rpartition(" ")
    return f"{side} {_PLURALS.get(part, part)}".strip()


def _number(words: list[str]) -> float | None:
    """The number that the words say, all of them; None where they say another thing."""
    found = number_at(words, 0)
    if found is None or found.rough or any(word not in ("of", "a") for word in words[found.used :]):
        return None
    return found.value
