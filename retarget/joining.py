"""How a new plan takes over from the one that plays: the jump of the divergent component dies away, and how fast.

The jump e0 is let down to zero over a time T. That moves the zero-moment point by up to `absorb_peak(T)` times e0, more
the shorter T is. The zero-moment point of a plan lies between the soles' centres, so a move that stays within part of
one sole stays within the support polygon, on one foot as on two.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexmotion.retarget.balance import absorb, absorb_offset

Float = NDArray[np.float64]

_LONGER = (1.0, 1.5, 2.0, 3.0)
"""Times tried, over the shortest: beyond three of them little is won, since a jump of e0 asks for e0 at the least."""
_ROOM_SHARE = 0.5
"""Of half a sole: the rest is for balance feedback."""


@dataclass(frozen=True)
class Absorbed:
    """A plan's balance after its join has been smoothed.

    Attributes:
        zmp, dcm: (T, 2) [m].
        excess: the farthest that the zero-moment point is moved, over the room for it; more than 1 does not fit.
    """

    zmp: Float
    dcm: Float
    excess: float


class JoinAbsorber:
    """Absorbs jumps of the divergent component within the room that the soles leave.

    Args:
        sole_half_size: half the length and width of a sole, (2,) [m].
        omega: of the pendulum [1/s]; dt: time a row [s].
        shortest_s: time over which a jump is absorbed where there is room for it.
    """

    def __init__(self, sole_half_size: Float, omega: float, dt: float, shortest_s: float) -> None:
        self.room = _ROOM_SHARE * sole_half_size
        self.omega, self.dt = omega, dt
        self._times = [
            (longer * shortest_s, float(np.abs(absorb_offset(longer * shortest_s, omega, dt)).max()))
            for longer in _LONGER
        ]

    def absorb(self, zmp: Float, dcm: Float, now: Float, yaw: float) -> Absorbed:
        """Bend a plan so that it starts at the divergent component `now`.

        Args:
            zmp, dcm: the plan, (T, 2) [m]; now: (2,) [m]; yaw: where the feet face [rad].
        """
        error = now - dcm[0]
        cos, sin = np.cos(yaw), np.sin(yaw)
        local = np.array([cos * error[0] + sin * error[1], cos * error[1] - sin * error[0]])
        asked = float(np.max(np.abs(local) / self.room))
        seconds, peak = next(((t, p) for t, p in self._times if p * asked <= 1.0), self._times[-1])
        zmp, dcm = absorb(zmp, dcm, error, self.omega, self.dt, seconds)
        return Absorbed(zmp, dcm, peak * asked)
