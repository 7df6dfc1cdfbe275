"""`MirrorState`: whether a run that mirrors does so now, and how it goes on, for answers and the status."""

from __future__ import annotations

from typing import Literal

from flexmotion.streamer.control.ladder import State
from flexmotion.streamer.control.tick_row import TickRow
from flexmotion.streamer.motion.mirror_source import SILENT_S
from flexmotion.streamer.motion.person_channel import PersonChannel, PersonRow

Mirrors = Literal["a person", "nobody", "not yet", "waits"]
"""a person: who is seen is mirrored. nobody: nobody is seen. not yet: a person is seen who is not followed, or not yet.
waits: for the text "mirror", since the robot was stopped, or told to stand."""

_FOLLOWS = (State.READY, State.STREAMING, State.HOLD)
_BEFORE = (State.OFF, State.GET_UP)
"""Nothing but a stop ends in them, as of the planner's record of targets: a robot that is armed for the first time
mirrors by itself."""


class MirrorState:
    """What a run that mirrors does.

    Args:
        channel: poses of the person who is seen.

    Attributes:
        waits: the robot was stopped, and mirrors nobody until it is told to.
    """

    def __init__(self, channel: PersonChannel) -> None:
        self.waits = False
        self._poses = channel.reader(new_only=True)
        self._seen_s = -float("inf")

    def update(self, row: TickRow | None) -> None:
        """Take the newest row of the loop, and the poses that have come."""
        if row is not None:
            self.waits |= bool(row.must_stop) or State(int(row.state)) not in (*_FOLLOWS, *_BEFORE)
        for pose in self._poses.read():
            self._seen_s = float(PersonRow(pose).arrived_s)

    def follows(self, *, rests: bool) -> None:
        """A target is followed: it asks to mirror, or else to stand."""
        self.waits = rests

    def ends(self) -> None:
        """The target that asks to mirror is over: its time to live is."""
        self.waits = True

    def mirrors(self, row: TickRow | None, now_s: float) -> Mirrors:
        """Whom the robot mirrors; the newest row of the loop, and the time (`time.perf_counter`) [s]."""
        if self.waits:
            return "waits"
        if now_s - self._seen_s > SILENT_S:
            return "nobody"
        return "a person" if row is not None and State(int(row.state)) is State.STREAMING else "not yet"
