"""`GestureBeside`: the human who stands and makes the gesture that another one makes on the way."""

from __future__ import annotations

import copy
from dataclasses import replace
from typing import Protocol

from flexmotion.human.motion import Motion
from flexmotion.sampling.beside import Beside, columns_of
from flexmotion.sampling.led_path import KNOWN
from flexmotion.streamer.motion.intents import Text


class GestureSource(Protocol):
    """Makes a gesture from its frame 0 on, before which its human stands; it has no end."""

    def drawn(self, first: int, last: int) -> Motion:
        """Frames from `first` to before `last`; the forces of the last ones may still change."""
        ...

    def forget(self, before: int) -> None:
        """Drop frames before that one."""
        ...


class GestureBeside:
    """A gesture from a frame on, made by a source of its own.

    Args:
        intent: the gesture.
        first: frame of the other human in which it begins.
        kind: of the gesture.
        source: that makes it.
    """

    def __init__(self, intent: Text, first: int, kind: str, source: GestureSource) -> None:
        self.intent, self.first, self._source, self._columns = intent, first, source, columns_of(kind)
        self._until = first

    def goes_on(self, intent: Text, frame: int) -> bool:
        """Whether an intent at a frame of the other human asks for more of it: it was made up to there."""
        return self.intent == intent and self.first <= frame <= self._until

    def window(self, first: int, frames: int) -> Beside:
        """What is made of it in a window of the other human, from frame `first` on."""
        joints = self._made(first, frames).joints
        self._until = max(self._until, first + frames)
        return Beside(joints, self._columns)

    def after_rest(self, frame: int) -> GestureBeside:
        """The gesture, which goes on at a frame after a rest, for whose time it has paused."""
        later = copy.copy(self)
        later.first += max(frame - self._until, 0)
        later._until = max(frame, self._until)
        return later

    def held(self, standing: Motion, frame: int) -> Motion:
        """The other human, who stands anew up to a frame, with the arms or the neck where the gesture goes on."""
        joints = standing.joints.copy()
        joints[:, self._columns] = self._made(frame, 0).joints[-1, self._columns]
        return replace(standing, joints=joints)

    def forget(self, before: int) -> None:
        """Frames of the other human before that one are asked for no more."""
        self._source.forget(before - self.first - KNOWN)

    def _made(self, first: int, frames: int) -> Motion:
        begin = first - self.first
        return self._source.drawn(begin - KNOWN, begin + frames)
