"""`GestureBeside`: the human who stands and makes the gesture that another one makes on the way."""

from __future__ import annotations

from dataclasses import replace

from flexmotion.human.motion import Motion
from flexmotion.sampling.beside import Beside, columns_of
from flexmotion.sampling.led_path import KNOWN
from flexmotion.streamer.motion.intents import Text
from flexmotion.streamer.motion.sources import Source


class GestureBeside:
    """A gesture from a frame on, made by a source of its own.

    Args:
        intent: the gesture.
        first: frame of the other human in which it begins.
        kind: of the gesture.
        source: that makes the gesture from its frame 0 on, before which it stands; it has no end.
    """

    def __init__(self, intent: Text, first: int, kind: str, source: Source) -> None:
        self.intent, self.first, self._source, self._columns = intent, first, source, columns_of(kind)
        self._until = first

    def goes_on(self, intent: Text, frame: int) -> bool:
        """Whether an intent at a frame of the other human asks for more of it: it was made up to there."""
        return self.intent == intent and self.first <= frame <= self._until

    def window(self, first: int, frames: int) -> Beside:
        """What is made of it in a window of the other human, from frame `first` on."""
        made = self._made(first, frames)
        self._until = first + frames
        return Beside(made.joints, self._columns)

    def held(self, standing: Motion, frame: int) -> Motion:
        """It goes on at a frame after a rest, for whose time it has paused: what was not made then still comes.

        Args:
            standing: the other human up to the frame, who stands anew.

        Returns:
            The same, with the arms or the neck where the gesture goes on.
        """
        self.first += max(frame - self._until, 0)
        self._until = max(frame, self._until)
        joints = standing.joints.copy()
        joints[:, self._columns] = self._made(frame, 0).joints[-1, self._columns]
        return replace(standing, joints=joints)

    def _made(self, first: int, frames: int) -> Motion:
        made = self._source.window(first - self.first - KNOWN, KNOWN + frames)
        assert made is not None
        return made
