"""`HumanAhead`: what the human that a robot follows still does in the frames that are sampled."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from flexmotion.human.motion import Motion
from flexmotion.sampling.course import MEASURED_S
from flexmotion.spatial.heading import continuous_heading

Float = NDArray[np.float64]

MEAN_S = MEASURED_S
"""Way and turn are means over this time, about one gait cycle [s]: a walking body sways within it."""


class SampledSource(Protocol):
    """A source that keeps its frames, at `fps`: see `ModelSource`."""

    @property
    def fps(self) -> float:
        """Frames a second."""
        ...

    def sampled(self, first: int) -> Motion | None:
        """See `ModelSource.sampled`."""
        ...


class Coming(Protocol):
    """What a human still does: see `HumanAhead.coming`."""

    def coming(self) -> tuple[float, Float] | None:
        """See `HumanAhead.coming`."""
        ...


class Looking(Protocol):
    """Where a human looks: see `HumanAhead.heading`."""

    def heading(self, after_s: float) -> float | None:
        """See `HumanAhead.heading`."""
        ...


@dataclass(frozen=True)
class HumanAhead:
    """The human of a source at a moment of the loop.

    Attributes:
        source: of the human.
        second: source time that the robot plays at the moment [s].
    """

    source: SampledSource
    second: float

    def coming(self) -> tuple[float, Float] | None:
        """What it does between its mean over the last `MEAN_S` and its mean over the last `MEAN_S` that are sampled.

        Returns:
            Time between both means [s], and ahead, left [m] and turn [rad] of the human, way in its own heading, (3,).
            None: frames of these times are dropped, or not sampled.
        """
        fps = self.source.fps
        frames, now = round(MEAN_S * fps), round(self.second * fps)
        motion = self.source.sampled(now - frames)
        if motion is None or len(motion) < 2 * frames:
            return None
        yaw = continuous_heading(motion.root_quaternion)
        moved = np.diff(motion.root_position[:, :2], axis=0)
        middle = 0.5 * (yaw[1:] + yaw[:-1])
        cosine, sine = np.cos(middle), np.sin(middle)
        own = [cosine * moved[:, 0] + sine * moved[:, 1], cosine * moved[:, 1] - sine * moved[:, 0]]
        way = np.column_stack([np.append(0.0, np.cumsum(one)) for one in own] + [yaw])
        return (len(motion) - frames) / fps, way[-frames:].mean(axis=0) - way[:frames].mean(axis=0)

    def heading(self, after_s: float) -> float | None:
        """Where it looks in a while, as a mean over `MEAN_S`, whole turns counted from some heading on [rad].

        Returns:
            None: the frames are dropped, or not sampled.
        """
        fps = self.source.fps
        frames, middle = round(MEAN_S * fps), round((self.second + after_s) * fps)
        motion = self.source.sampled(middle - frames // 2)
        if motion is None or len(motion) < frames:
            return None
        return float(continuous_heading(motion[:frames].root_quaternion).mean())
