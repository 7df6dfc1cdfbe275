"""N-step capturability: in how many steps a linear inverted pendulum comes to a stand after a push.

Koolen et al. 2012 (Int. J. Robotics Research 31(9)): the divergent component x of the pendulum leaves a fixed
zero-moment point p as x(t) = p + (x - p) e^(wt). A state is captured in N steps where some p within the sole and some
foothold within reach lead to one that is captured in N - 1. Ahead and aside are independent of each other, soles and
reaches are taken as boxes: then the captured states are boxes too, and an interval for each axis says it all.

Nothing but geometry and time bounds such a robot: no servo, no time to notice the push, no height of a torso that
tilts. What cannot be recovered here, no robot of this size can; the reverse does not hold.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Float = NDArray[np.float64]

MOST_STEPS = 4
"""Steps that are counted; more gain less than a millimetre where a step takes three time constants of the pendulum."""


@dataclass(frozen=True)
class Walker:
    """What a robot's steps can do.

    Attributes:
        omega: natural frequency of the pendulum [1/s].
        step_s: from a touch-down to the next, at least [s].
        sole: half the length and width of a sole, (2,) [m].
        ahead: how far a foot may be behind and ahead of the other, (2,) [m].
        aside: distance of the feet, at least and at most, (2,) [m].
    """

    omega: float
    step_s: float
    sole: Float
    ahead: Float
    aside: Float


def steps_to_capture(walker: Walker, dcm: Float, feet: Float, swing: int | None, landing_s: float) -> int | None:
    """Fewest steps by which a robot comes to a stand; None: more than `MOST_STEPS`, it falls.

    Args:
        dcm: divergent component, (2,) [m].
        feet: soles, left then right: x, y and yaw, (2, 3) [m, m, rad]; of the foot in the air: anywhere.
        swing: the foot in the air, 0 left, 1 right; None: both stand.
        landing_s: until it lands; where both stand a step takes `Walker.step_s` [s].
    """
    if swing is None:
        if _between(walker, dcm, feet):
            return 0
        # Either foot may step; the other one carries the robot meanwhile.
        found = [_steps(walker, _seen_from(dcm, feet, 1 - side), walker.step_s) for side in (0, 1)]
        return min((steps for steps in found if steps is not None), default=None)
    local = _seen_from(dcm, feet, 1 - swing)
    if (np.abs(local) <= walker.sole).all():
        return 0
    return _steps(walker, local, landing_s)


def _seen_from(dcm: Float, feet: Float, stance: int) -> Float:
    """A point seen from a foot, (2,): ahead, and aside toward where the other foot belongs [m]."""
    x, y, yaw = feet[stance]
    dx, dy = dcm - (x, y)
    cos, sin = np.cos(yaw), np.sin(yaw)
    toward = 1.0 if stance == 1 else -1.0
    return np.array([cos * dx + sin * dy, toward * (cos * dy - sin * dx)])


def _between(walker: Walker, dcm: Float, feet: Float) -> bool:
    """Whether a point is above the box around both soles, in the frame midway between them."""
    yaw = float(feet[:, 2].mean())
    turn = np.array([[np.cos(yaw), np.sin(yaw)], [-np.sin(yaw), np.cos(yaw)]])
    soles, point = feet[:, :2] @ turn.T, turn @ dcm
    low, high = soles.min(axis=0) - walker.sole, soles.max(axis=0) + walker.sole
    return bool(((point >= low) & (point <= high)).all())


def _steps(walker: Walker, local: Float, first_s: float) -> int | None:
    """Steps from a stance on one foot; `first_s` until the other one lands."""
    for steps in range(1, MOST_STEPS + 1):
        low, high = _captured(walker, steps - 1)
        shrink = float(np.exp(-walker.omega * first_s))
        begin, end = _before(walker, low, high, shrink)
        if ((local >= begin) & (local <= end)).all():
            return steps
    return None


def _before(walker: Walker, low: Float, high: Float, shrink: float) -> tuple[Float, Float]:
    """Box of states, seen from the standing foot, that a step leads into a box seen from the foot that lands."""
    # Aside both feet look toward each other: what is beyond the foot that lands is negative for it.
    reach_low = np.array([walker.ahead[0] + low[0], walker.aside[0] - high[1]])
    reach_high = np.array([walker.ahead[1] + high[0], walker.aside[1] - low[1]])
    held = (1.0 - shrink) * walker.sole
    return shrink * reach_low - held, shrink * reach_high + held


def _captured(walker: Walker, steps: int) -> tuple[Float, Float]:
    """Box of states just after a touch-down, seen from the foot that has landed, captured in that many further steps.

    With none the robot stands: on the foot that has landed, or on both.
    """
    low, high = -walker.sole, walker.sole + np.array([0.0, walker.aside[0]])
    shrink = float(np.exp(-walker.omega * walker.step_s))
    for _ in range(steps):
        begin, end = _before(walker, low, high, shrink)
        low, high = np.minimum(low, begin), np.maximum(high, end)
    return low, high
