"""`Pace`: how fast somebody is asked to go at most, so that who follows keeps up."""

from __future__ import annotations

from dataclasses import dataclass

Velocity = tuple[float, float, float]


@dataclass(frozen=True)
class Pace:
    """Greatest velocities of a human as seen from where it faces.

    Attributes:
        ahead, back, aside: [m/s].
        turning: [rad/s].
    """

    ahead: float
    back: float
    aside: float
    turning: float

    def slowed(self, velocity: Velocity) -> Velocity:
        """The same way, slower where it is too fast: all parts by one factor, so that a curve stays the same curve.

        Ahead and aside share what there is (an ellipse); turning has its own limit.
        """
        forward, left, turning = velocity
        along, across = forward / (self.ahead if forward > 0 else self.back), left / self.aside
        share = max((along**2 + across**2) ** 0.5, abs(turning) / self.turning, 1.0)
        return forward / share, left / share, turning / share
