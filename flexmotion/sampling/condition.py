"""`Condition`: what is asked of one window."""

from __future__ import annotations

from dataclasses import dataclass

from flexmotion.features.constraints import Constraints
from flexmotion.sampling.kept_pose import KeptPose
from flexmotion.sampling.pace import Pace
from flexmotion.sampling.rhythm import Rhythm


@dataclass(frozen=True)
class Condition:
    """Request for one window.

    Attributes:
        text: what to do, in words; None for standing still, or for walking where there is a velocity. Words that mean a
            velocity ("step to the left") stand for that velocity unless another is given.
        velocity: of the root in its own heading: forward, left [m/s], turning left [rad/s]; None for none. A velocity
            without words that is nearly zero means standing still.
        wordless: whether nothing is said of what to do, in words or manner: the history goes on, at the velocity, which
            is asked as it is. `text` and `manner` do not count then.
        manner: in which to do it; None for the one that the words say, which is the normal one where they say none.
        guidance: scale of classifier-free guidance; None for the kind's, or the bundle's default.
        manner_guidance: likewise, of the manner against any manner.
        pace: greatest velocities; velocities beyond it, and words that mean faster ones ("run"), are slowed. None for
            no limit.
        asked: velocity that the model is asked for so that the motion keeps its `Course`, beside the words, or instead
            of `velocity`; None for no such correction.
        noise: factor of the noise that the window is sampled from.
        constraints: places, angles, path and forces that are asked of single frames, means of the path; None for none.
        pose: in which the arms are kept, or the gesture that they and the head make; None: they move as sampled,
            and words of a rhythm begin with this window.
        held: whether the pose that is asked for is reached, so that the window is quiet.
    """

    text: str | None = None
    velocity: tuple[float, float, float] | None = None
    wordless: bool = False
    manner: str | None = None
    guidance: float | None = None
    manner_guidance: float | None = None
    pace: Pace | None = None
    asked: tuple[float, float, float] | None = None
    noise: float = 1.0
    constraints: Constraints | None = None
    pose: KeptPose | Rhythm | None = None
    held: bool = False

    @property
    def constrained(self) -> Constraints | None:
        """The constraints where they ask for anything, else None."""
        return self.constraints if self.constraints is not None and self.constraints.asked else None
