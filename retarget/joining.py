"""Joins of plans: how fast the jump of the divergent component from the current plan to the new one decays.

The jump e0 decays to zero over a time T. That displaces the zero-moment point by up to the maximum of
`balance.absorb_offset(T)` times e0, which is larger for a shorter T. The zero-moment point of a plan is between the
soles, less than half of a half sole from the line between their centres, so a displacement within the other half stays
within the support polygon, in single and double support.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexmotion.retarget.balance import absorb, absorb_offset

Float = NDArray[np.float64]

_LONGER = (1.0, 1.5, 2.0, 3.0)
"""Decay times, over the shortest. Longer ones gain little: the displacement is never smaller than the jump."""
_ROOM_SHARE = 0.5
"""Share of half a sole that a join may use; the rest is for balance feedback."""


@dataclass(frozen=True)
class Absorbed:
    """A plan's balance after its join has been smoothed.

    Attributes:
        zmp, dcm: (T, 2) [m].
        excess: largest displacement of the zero-moment point over the room for it; more than 1 does not fit.
    """

    zmp: Float
    dcm: Float
    excess: float


class JoinAbsorber:
    """Absorbs jumps of the divergent component within the room on the soles.

    Args:
        sole_half_size: half the length and width of a sole, (2,) [m].
        omega: natural frequency of the pendulum [1/s]; dt: time a row [s].
        shortest_s: decay time of a jump where there is room for it [s].
    """

    def __init__(self, sole_half_size: Float, omega: float, dt: float, shortest_s: float) -> None:
        self.room = _ROOM_SHARE * sole_half_size
        self.omega, self.dt = omega, dt
        self._times = [
            (longer * shortest_s, float(np.abs(absorb_offset(longer * shortest_s, omega, dt)).max()))
            for longer in _LONGER
        ]

    def absorb(self, zmp: Float, dcm: Float, now: Float, yaw: float) -> Absorbed:
        """Change a plan so that it starts at the divergent component `now`.

        Args:
            zmp, dcm: the plan, (T, 2) [m]; now: (2,) [m]; yaw: mean heading of the feet [rad].
        """
        error = now - dcm[0]
        cos, sin = np.cos(yaw), np.sin(yaw)
        local = np.array([cos * error[0] + sin * error[1], cos * error[1] - sin * error[0]])
        jump = float(np.max(np.abs(local) / self.room))
        seconds, peak = next(((t, p) for t, p in self._times if p * jump <= 1.0), self._times[-1])
        zmp, dcm = absorb(zmp, dcm, error, self.omega, self.dt, seconds)
        return Absorbed(zmp, dcm, peak * jump)
