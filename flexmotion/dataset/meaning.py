"""What a clip shows: its kind of motion and its manner, from the labels and captions of its source.

An index names kinds and styles itself. Captions are read by the rules that `phrases.yaml` lists (`captions`, regular
expressions): a caption of one motion has that kind, one of several motions has none. A caption that says no manner is
of the normal one; where it says one that `manners.yaml` does not list, the manner is unknown.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache

from flexmotion.text import manners, phrases
from flexmotion.text.manner_phrases import manner_phrases

UNREADABLE = re.compile(
    r"\b(?:uneven|stairs?|slope|ramp|ladder|climb\w*|obstacle\w*|then|afterwards|before|after|while|stops?|sits?|falls?|around|over|jump\w*|hop\w*|squat\w*"
    r"|twist\w*|flips?|dribbl\w*|ball)\b"
)
"""Words of captions that show more, or something else, than one kind of motion on a level floor."""


SHOWN = 0.25
"""Least share of a window in which a clip shows its kind, for the window to be of that kind; and greatest share that
has passed when a gesture is left, for the window to be of the kind around it."""


@dataclass(frozen=True)
class Shown:
    """When a clip shows its kind of motion.

    Attributes:
        start, end: in the clip [s].
        around: kind of motion before and after.
        left: when its last pose is left, on the way to what is around it [s]; None where that is not known.
    """

    start: float
    end: float
    around: str
    left: float | None = None

    def covers(self, first: float, last: float) -> bool:
        """Whether a window from `first` to `last` [s] is of the clip's kind: shows it, and does not leave it.

        A robot that is asked for a pose keeps it until something else is asked. A model that learns the way back under
        the name of the pose lowers its hands by chance.
        """
        if self.left is not None and last > self.left:
            return False
        return min(self.end, last) - max(self.start, first) >= SHOWN * (last - first)

    def leaves(self, first: float, last: float) -> bool:
        """Whether a window leaves the gesture so late that it is neither of its kind nor of what is around it."""
        return self.left is not None and first + SHOWN * (last - first) < self.left < last


def shown(labels: Mapping[str, str]) -> Shown | None:
    """When a clip shows its kind, by `start_s`, `end_s`, `left_s` and `around` of its index; None: all the time."""
    if not labels.get("end_s"):
        return None
    left = labels.get("left_s")
    return Shown(float(labels["start_s"]), float(labels["end_s"]), labels["around"], float(left) if left else None)


def clip_kind(labels: Mapping[str, str], captions: Sequence[str]) -> str:
    """Kind of motion of a clip; empty where neither its labels nor its captions tell one.

    Args:
        labels: `content` or `action` of its index.
        captions: sentences about the whole clip.
    """
    if labels.get("content"):
        return labels["content"]
    found = {kind for kind in (_captioned_kind(text.lower()) for text in captions) if kind is not None}
    if len(found) == 1:
        return found.pop()
    action = labels.get("action", "")
    # The captions say more than the word of an index: "walk forward, turn around, walk back" is its "walk".
    return action if not captions else ""


def clip_manner(labels: Mapping[str, str], captions: Sequence[str]) -> str | None:
    """Manner of a clip; None where it is unknown.

    Args:
        labels: `style` of its index.
        captions: sentences about the whole clip.
    """
    if labels.get("style"):
        return manners.manner_of_style(labels["style"])
    if not clip_kind(labels, captions):
        return None
    said = {phrase.manner for text in captions for phrase in manner_phrases(text)}
    if not said:
        return manners.NORMAL
    return said.pop() if len(said) == 1 else None


def _captioned_kind(text: str) -> str | None:
    """Kind of motion of a caption; None: no rule knows it, empty: it is of several kinds."""
    rest, found = text, set()
    for kind, rule in _kind_rules():
        rest, times = rule.subn(" ", rest)
        found |= {kind} if times else set()
    if not found:
        return None
    return "" if len(found) > 1 or UNREADABLE.search(text) else found.pop()


@lru_cache
def _kind_rules() -> tuple[tuple[str, re.Pattern[str]], ...]:
    rules = [(kind, pattern) for kind in phrases.kinds() for pattern in phrases.caption_patterns(kind)]
    # Kinds of longer names are more particular: "walks backwards" (walk-back) is no walk ahead (walk).
    rules.sort(key=lambda rule: -len(rule[0].split("-")))
    return tuple((kind, re.compile(pattern)) for kind, pattern in rules)
