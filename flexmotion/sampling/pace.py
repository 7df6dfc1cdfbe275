"""`Pace`: greatest velocities of a human that a robot can follow."""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from math import hypot, isfinite


@dataclass(frozen=True)
class Pace:
    """Greatest velocities of a human in its own heading.

    Attributes:
        ahead, back, aside: [m/s].
        turning: [rad/s].
        reached: the robot's own greatest speed ahead, in the scale of the human [m/s]; None: as `ahead`.
        curve_with_arms: share of the speed of a walked turn with both arms away from the body.

    Raises:
        ValueError: one of them is not positive and finite.
    """

    ahead: float
    back: float
    aside: float
    turning: float
    reached: float | None = None
    curve_with_arms: float = 1.0

    def __post_init__(self) -> None:
        speeds = [speed for name, speed in asdict(self).items() if name != "reached" or speed is not None]
        if not all(isinstance(speed, float | int) and isfinite(speed) and speed > 0 for speed in speeds):
            raise ValueError(f"expected finite speeds above 0, found {self}")

    def slowed(self, velocity: tuple[float, float, float]) -> tuple[float, float, float]:
        """The velocity, scaled down to the limits: all components by one factor, so that a path keeps its shape.

        Forward and sideways velocity are limited together by an ellipse, turning on its own.
        """
        forward, left, turning = velocity
        along, across = forward / (self.ahead if forward > 0 else self.back), left / self.aside
        share = max(hypot(along, across), abs(turning) / self.turning, 1.0)
        return forward / share, left / share, turning / share

    def shown(self, velocity: tuple[float, float, float]) -> tuple[float, float, float]:
        """The velocity, slowed to what the robot shows of it: beyond `reached` it goes no faster."""
        reached = self.ahead if self.reached is None else min(self.ahead, self.reached)
        return replace(self, ahead=reached).slowed(velocity)
