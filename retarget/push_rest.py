"""`PushRest`: keeps a foot down over whose outer edge a pushed robot leans, and the weight between the feet meanwhile.

A push outward tips a robot onto the outer edge of the sole that carries it. Its divergent component x is inside of that
edge p still, and comes back with p + (x - p) e^(wt) (Englsberger et al. 2015, IEEE T-RO 31(2)): the nearer to the edge
the later, while the plan has the other foot land on time and then lifts the one that carries all. Here that lift waits:
the other foot lands as planned, the plan comes to rest over both feet, also ahead, and the robot rocks back onto them.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from flexmotion.retarget.steps import Step

Float = NDArray[np.float64]

LEAN_M = 0.04
"""A divergent component that is this much further outward than planned is answered [m]. In late swings and double
support, walks in five directions that nobody pushes have up to 30 mm."""
REST_S = 0.9
"""The foot that was to lift stays down for this long after the other one has landed [s]: 0.6 was too short for one of
five pushes on which it was chosen."""
_BEGUN = 0.7
"""Share of the way between the feet beyond which the plan's divergent component is on its way to the other foot: then
the plan could stop only by a zero-moment point beyond that foot's edge. Rests that began at .85 or more fell."""


def outward(error: Float, side: int, yaw: float) -> float:
    """How far a displacement in the plan's world leads outward from a foot, away from the other one [m].

    Args:
        error: (2,) [m].
        side: of the foot, 0 left, 1 right; yaw: of its sole [rad].
    """
    left = float(np.cos(yaw) * error[1] - np.sin(yaw) * error[0])
    return left if side == 0 else -left


class PushRest:
    """Rests of one robot after pushes.

    Args:
        rate_hz: loop ticks a second.
    """

    def __init__(self, rate_hz: float) -> None:
        self.rate = rate_hz

    def answer(self, steps: list[Step], feet: Float, dcm: Float, tick: int, error: Float) -> tuple[list[Step], float]:
        """Put off the lift of the foot over which the robot leans, and the steps after it.

        Args:
            steps: settled steps, in order; the first may be under way.
            feet: poses of both feet, (2, 4) [m, m, m, rad].
            dcm: planned divergent component, (2,) [m].
            tick: from which the steps change.
            error: divergent component, measured minus planned, (2,) [m].

        Returns:
            The steps, and the tick before which no foot lifts; -infinite: they are unchanged.
        """
        unchanged = steps, -np.inf
        if not steps or not np.isfinite(error).all():
            return unchanged
        first = steps[0]
        swings = first.lift < tick
        side = first.stance if swings else first.side
        place = next((k for k, step in enumerate(steps) if step.side == side and step.lift > tick), None)
        foot, other = feet[side], first.target if swings else feet[1 - side]
        if place is None or outward(error, side, foot[3]) < LEAN_M:
            return unchanged
        way, whole = (-outward(point - foot[:2], side, foot[3]) for point in (dcm, other[:2]))
        if way > _BEGUN * whole:
            return unchanged
        rests = (first.land if swings else tick) + round(REST_S * self.rate)
        later = rests - steps[place].lift
        if later <= 0:
            return unchanged
        return [*steps[:place], *(self._later(step, later, tick) for step in steps[place:])], float(rests)

    def _later(self, step: Step, ticks: int, tick: int) -> Step:
        """A step that is later by some ticks, and settled from `tick` on all the same."""
        lift = step.lift + ticks
        return replace(
            step, lift=lift, land=step.land + ticks, notice_s=max(step.notice_s, (lift - tick + 1) / self.rate)
        )
