"""Where human motion comes from: a source gives frames from its own clock, as far ahead as the planner asks."""

from __future__ import annotations

from typing import Protocol, Self, runtime_checkable

import numpy as np

from flexmotion.configs.errors import MotionFormatError
from flexmotion.human.body import Body
from flexmotion.human.motion import Motion
from flexmotion.streamer.motion.targets import Target


class Source(Protocol):
    """Human motion by frame index; frame 0 is played at the source's time 0.

    Attributes:
        name: what the report says it came from.
        fps: frames a second.
    """

    name: str
    fps: float

    def window(self, first_frame: int, frames: int) -> Motion | None:
        """`frames` frames from `first_frame` on, fewer where the source ends, None where it is over."""
        ...


@runtime_checkable
class LiveSource(Source, Protocol):
    """A source that follows targets."""

    def turn_to(self, target: Target, frame: int, played: Motion | None) -> str | None:
        """From `frame` on follow `target`; what comes back is told: how it is followed otherwise than it is meant.

        Args:
            target: what to do.
            frame: at which the human as it was goes over into what the target asks for.
            played: the human as played, some frames up to and with that one; None where it does not move: before the
                first plan, or after a stop.

        Raises:
            ConfigError: this source cannot follow such a target.
        """
        ...


@runtime_checkable
class Performance(Source, Protocol):
    """A source that is streamed by itself from its start, and can say what the human does in it.

    Attributes:
        body: whose motion it is.
    """

    body: Body

    @property
    def seconds(self) -> float | None:
        """How long it lasts [s]; None: without an end."""
        ...

    @property
    def remarks(self) -> tuple[str, ...]:
        """What somebody should be told before it begins: how it is followed otherwise than may be meant."""
        ...

    def cut(self, seconds: float) -> Self:
        """The first part of it, from the start anew."""
        ...

    def human(self) -> Motion:
        """All that the human does where no target comes in between; only of one with an end."""
        ...


class ClipSource:
    """A clip played from its start, once."""

    def __init__(self, motion: Motion) -> None:
        """Raises `MotionFormatError` where there is nothing to play."""
        if len(motion) < 2:
            raise MotionFormatError(f"{motion.source or 'clip'}: has {len(motion)} frame(s), needs at least two")
        self.motion = motion
        self.name = motion.source or "clip"
        self.fps, self.body = motion.fps, motion.body

    @property
    def seconds(self) -> float:
        """Length of the clip [s]."""
        return self.motion.duration

    @property
    def remarks(self) -> tuple[str, ...]:
        """See `Performance.remarks`: a clip says all itself."""
        return ()

    def window(self, first_frame: int, frames: int) -> Motion | None:
        """See `Source.window`."""
        cut = self.motion[first_frame : first_frame + frames]
        return cut if len(cut) >= 2 else None

    def cut(self, seconds: float) -> ClipSource:
        """The first part of the clip."""
        source = ClipSource(self.motion[: int(np.floor(seconds * self.fps)) + 1])
        source.name = self.name
        return source

    def human(self) -> Motion:
        """See `Performance.human`."""
        return self.motion
