"""`Source`: human motion by frame index on a clock of its own, as far ahead as the planner requests."""

from __future__ import annotations

from typing import Protocol, Self, runtime_checkable

import numpy as np

from flexmotion.configs.errors import MotionFormatError
from flexmotion.human.body import Body
from flexmotion.human.motion import Motion
from flexmotion.streamer.motion.targets import Target
from flexmotion.streamer.motion.undo import Undo


@runtime_checkable
class Source(Protocol):
    """Human motion by frame index; frame 0 is at the source's time 0.

    Attributes:
        name: for the report.
        fps: frames a second.
    """

    name: str
    fps: float

    def window(self, first_frame: int, frames: int) -> Motion | None:
        """`frames` frames from `first_frame` on; fewer at the end of the source; None after it."""
        ...


@runtime_checkable
class LiveSource(Source, Protocol):
    """A source that follows targets."""

    def turn_to(self, target: Target, frame: int, played: Motion | None, yaw: float | None = None) -> str | None:
        """Follow `target` from `frame` on.

        Args:
            target: what to do.
            frame: last frame of the motion as it was; the next one follows the target.
            played: the human as played, some frames up to and including that one; None if it does not move: before the
                first plan, or after a stop.
            yaw: heading at which a human that does not move stands [rad]: where the robot's feet point, so that the
                robot does not make up for what it lagged behind when it stopped; None: as the human stood.

        Returns:
            A message for the operator, if the intent is changed before it is followed.

        Raises:
            ConfigError: this source cannot follow such a target.
        """
        ...

    def kept(self) -> Undo:
        """What brings the source back to how it is now, for a target that it has turned to and that is given up."""
        ...


@runtime_checkable
class Performance(Source, Protocol):
    """A source that can be streamed from its start without targets, and whose whole motion is known.

    Attributes:
        body: of the human.
    """

    body: Body

    @property
    def seconds(self) -> float | None:
        """Length [s]; None: without an end."""
        ...

    @property
    def remarks(self) -> tuple[str, ...]:
        """Messages for the operator before the start: intents that are changed before they are followed."""
        ...

    def cut(self, seconds: float) -> Self:
        """A source of the first part, at its start."""
        ...

    def human(self) -> Motion:
        """The whole motion without targets. Raises `ValueError` if the source has no end."""
        ...


class ClipSource:
    """A clip played from its start, once."""

    def __init__(self, motion: Motion) -> None:
        """Raises `MotionFormatError` if the clip has fewer than two frames."""
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
        """See `Performance.remarks`: none, a clip is followed as it is."""
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
