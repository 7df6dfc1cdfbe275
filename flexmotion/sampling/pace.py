"""`Pace`: how fast somebody is asked to go at most, so that who follows keeps up."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from math import hypot, isfinite


@dataclass(frozen=True)
class Pace:
    """Greatest velocities of a human as seen from where it faces.

    Attributes:
        ahead, back, aside: [m/s].
        turning: [rad/s].

    Raises:
        ValueError: one of them is not positive and finite.
    """

    ahead: float
    back: float
    aside: float
    turning: float

    def __post_init__(self) -> None:
        if not all(isinstance(speed, float | int) and isfinite(speed) and speed > 0 for speed in asdict(self).values()):
            raise ValueError(f"expected finite speeds above 0, found {self}")

    def slowed(self, velocity: tuple[float, float, float]) -> tuple[float, float, float]:
        """The same way, slower where it is too fast: all parts by one factor, so that a curve stays the same curve.

        Ahead and aside share what there is (an ellipse); turning has its own limit.
        """
        forward, left, turning = velocity
        along, across = forward / (self.ahead if forward > 0 else self.back), left / self.aside
        share = max(hypot(along, across), abs(turning) / self.turning, 1.0)
        return forward / share, left / share, turning / share
