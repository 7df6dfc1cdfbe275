"""`Condition`: what is asked of one window."""

from __future__ import annotations

from dataclasses import dataclass
from math import isfinite

from flexmotion.configs.errors import SamplingError
from flexmotion.features.constraints import Constraints
from flexmotion.sampling.beside import Beside
from flexmotion.sampling.kept_pose import KeptPose
from flexmotion.sampling.pace import Pace
from flexmotion.sampling.rhythm import Rhythm

GREATEST_VELOCITY = (6.0, 3.0, 6.0)
"""Greatest velocity that may be asked for, in either direction [m/s, m/s, rad/s]: twice that of a live target
(`streamer.motion.intents.FASTEST`). Words mean up to 3.45 m/s ("dash"), and mirrored people are fast."""


@dataclass(frozen=True)
class Condition:
    """Request for one window.

    Attributes:
        text: what to do, in words; None for standing still, or for walking where there is a velocity. Words that mean a
            velocity ("step to the left") stand for that velocity unless another is given.
        velocity: of the root in its own heading: forward, left [m/s], turning left [rad/s]; None for none. A velocity
            without words that is nearly zero means standing still.
        tempo: factor on the speed of a rhythm that the words mean; no other motion has one.
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
        beside: a gesture of arms or head that is made meanwhile; None: there is none.
        held: whether the pose that is asked for is reached, so that the window is quiet.

    Raises:
        SamplingError: a number is not finite, a velocity has not three of them or is beyond `GREATEST_VELOCITY`, or
            the noise or the tempo is negative.
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
    beside: Beside | None = None
    held: bool = False
    tempo: float = 1.0

    def __post_init__(self) -> None:
        _require_velocity("velocity", self.velocity, "within " + _bounds(), GREATEST_VELOCITY)
        _require_velocity("asked", self.asked, "that are finite", (float("inf"),) * 3)
        for name, least in (("guidance", None), ("manner_guidance", None), ("noise", 0.0), ("tempo", 0.0)):
            value = getattr(self, name)
            if value is not None and not (_is_finite(value) and (least is None or value >= least)):
                expected = "a finite number" + ("" if least is None else f", {least:g} or more")
                raise SamplingError(f"Condition.{name} is {value!r}, expected {expected}")

    @property
    def constrained(self) -> Constraints | None:
        """The constraints where they ask for anything, else None."""
        return self.constraints if self.constraints is not None and self.constraints.asked else None


def _require_velocity(name: str, value: tuple[float, ...] | None, expected: str, greatest: tuple[float, ...]) -> None:
    if value is None:
        return
    fine = len(value) == len(greatest) and all(map(_is_finite, value))
    if not fine or any(abs(number) > most for number, most in zip(value, greatest, strict=True)):
        units = "forward m/s, left m/s, turning rad/s"
        raise SamplingError(f"Condition.{name} is {value!r}, expected three numbers {expected}: {units}")


def _bounds() -> str:
    return f"[{', '.join(f'±{most:g}' for most in GREATEST_VELOCITY)}]"


def _is_finite(value: object) -> bool:
    try:
        return isfinite(value)  # type: ignore[arg-type]
    except TypeError:
        return False
