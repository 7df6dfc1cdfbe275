"""`is_alarm`: words of somebody who wants everything to stop now ("emergency stop", "halt", "stop!")."""

from __future__ import annotations

import re

_NAMES = re.compile(
    r"(?:(?:emergency|e)\s(?:stop|halt|off)(?:\sbutton)?|estop|emergency|halt|abort|panic(?:\sbutton)?|stop\severything)"
)
"""An alarm by themselves."""

_STOPS = re.compile(r"(?:stop|halt)(?:\s(?:it|that|this|moving))?")
"""An alarm where they are shouted, repeated or urgent; else a stand, such as the end of a walk."""

_URGENT = re.compile(r"\b(?:now|immediately|instantly|at once|help|right away)\b")
_BESIDE = re.compile(
    r"\b(?:please|robot|hey|oh|ok|okay|god|just|right|the|an?|do|make|press|hit|push|activate|trigger)\b"
)

_NO = re.compile(r"\bno\b\s*(?:[,.!;:-]|(?=(?:no|stop|halt)\b))")
"""A cry ("no, stop!"); that of "no emergency" is none."""


def is_alarm(sentence: str) -> bool:
    """Whether a whole sentence asks for nothing but a stop, and in alarm. Longer sentences are left to the grammar."""
    words = " ".join(re.findall(r"[a-z'’]+", _NO.sub(" ", sentence.lower())))
    core = " ".join(_BESIDE.sub(" ", _URGENT.sub(" ", words)).split())
    if re.fullmatch(rf"{_NAMES.pattern}(?:\s{_NAMES.pattern})*", core):
        return True
    stops = re.fullmatch(rf"{_STOPS.pattern}(?:\s{_STOPS.pattern})*", core)
    shouted = "!" in sentence or sentence.isupper() or _URGENT.search(words) is not None
    return stops is not None and (shouted or len(re.findall(r"stop|halt", core)) > 1)
