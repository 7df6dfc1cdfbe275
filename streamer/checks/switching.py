"""Targets that change at random moments, and clips to switch between."""

from __future__ import annotations

import random
from collections.abc import Sequence

from flexmotion.human.motion import Motion
from flexmotion.importers.default_clip import default_clip
from flexmotion.streamer.motion.clip_library import ClipLibrary
from flexmotion.streamer.motion.intents import Clip, Intent
from flexmotion.streamer.motion.targets import TargetMailbox

SETTLE_S = 2.0
"""Time from the start to the first switch [s]."""
BETWEEN_S = (0.2, 1.0)
"""Range of the time between two switches, uniformly distributed [s]."""


def shipped_clips() -> dict[str, Motion]:
    """Parts of the shipped clip: both arms waving, a few steps, standing at ease."""
    motion = default_clip()
    return {"wave": motion[0:225], "walk": motion[225:330], "stand": motion[330:510]}


def switched(clips: dict[str, Motion]) -> tuple[ClipLibrary, tuple[Intent, ...]]:
    """A source that plays clips, beginning with the first, and the targets that it follows."""
    return ClipLibrary(clips, next(iter(clips))), tuple(Clip(name) for name in sorted(clips))


class RandomTargets:
    """Sends targets at random moments, never the same one twice in a row.

    Args:
        targets: mailbox to send to.
        intents: intents to choose from, two or more.
        seed: of moments and choices.

    Attributes:
        sent: number of targets sent.
    """

    def __init__(self, targets: TargetMailbox, intents: Sequence[Intent], seed: int) -> None:
        self.targets, self.intents = targets, intents
        self.sent = 0
        self._random, self._next = random.Random(seed), SETTLE_S
        self._asked: Intent | None = None

    def at(self, passed: float) -> None:
        """Send a target if one is due; `passed` is the time since the start [s]."""
        if passed >= self._next:
            self._next = passed + self._random.uniform(*BETWEEN_S)
            self._asked = self._random.choice([intent for intent in self.intents if intent != self._asked])
            self.targets.send(self._asked)
            self.sent += 1
