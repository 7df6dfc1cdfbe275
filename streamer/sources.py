"""Where human motion comes from: a source gives frames from its own clock, as far ahead as the planner asks."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from configs.errors import MotionFormatError
from flexmotion.motion import Motion


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


class ClipSource:
    """A clip played from its start, once."""

    def __init__(self, motion: Motion) -> None:
        """Raises `MotionFormatError` where there is nothing to play."""
        if len(motion) < 2:
            raise MotionFormatError(f"{motion.source or 'clip'}: has {len(motion)} frame(s), needs at least two")
        self.motion = motion
        self.name = f"clip:{motion.source}" if motion.source else "clip"
        self.fps = motion.fps

    @property
    def seconds(self) -> float:
        """Length of the clip [s]."""
        return self.motion.duration

    def window(self, first_frame: int, frames: int) -> Motion | None:
        """See `Source.window`."""
        cut = self.motion[first_frame : first_frame + frames]
        return cut if len(cut) >= 2 else None

    def cut(self, seconds: float) -> ClipSource:
        """The first part of the clip."""
        source = ClipSource(self.motion[: int(np.floor(seconds * self.fps)) + 1])
        source.name = self.name
        return source
