"""Cut-off of the low-pass filter around landings and take-offs, where forces change faster than in walking.

The common 6 Hz spread a landing over .15 s, half of it into the flight. Studies of landings and jumps filter kinematics
and forces alike at 10 to 15 Hz (Bisseling & Hof, J. Biomechanics 39:2438, 2006; Kristianslund et al., J. Biomechanics
45:666, 2012). Only the frames near such an event get that cut-off.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from flexmotion.biomechanics.differentiation import derivative
from flexmotion.biomechanics.sole import REACH
from flexmotion.human.kinematics import forward
from flexmotion.human.motion import Motion

Float = NDArray[np.float64]

LANDING_CUTOFF = 11.0
"""At the event [Hz]. Chosen on one drop jump of one person, within the 10 to 15 Hz of the studies above."""

SPEED = 1.0
"""Least vertical speed of the pelvis at the event [m/s]: that of a flight of .2 s. A runner's is below it.

Like `LANDING_CUTOFF` and `WIDTH_S` it comes from one drop jump with force plates.
"""

WIDTH_S = 0.15
"""Time from the event within which the cut-off is raised [s]; the width of a landing at 6 Hz in the same drop jump."""


def landing_cutoff(level: Motion, cutoff: float) -> Float | None:
    """Cut-off of every frame, (T,) [Hz]; None for a motion without such an event.

    Args:
        level: smoothed at the cut-off, over a floor at z = 0.
        cutoff: elsewhere [Hz].
    """
    if cutoff >= LANDING_CUTOFF or len(level) < 3:
        return None
    human = forward(level)
    airborne = np.concatenate([human.heel, human.toe], axis=1)[..., 2].min(axis=1) > REACH
    speed = np.abs(derivative(level.root_position[:, 2], level.fps))
    events = np.flatnonzero(np.diff(airborne)) + 1
    events = events[speed[events] > SPEED]
    if not len(events):
        return None
    distance = np.abs(np.arange(len(level))[:, None] - events).min(axis=1) / level.fps
    found: Float = cutoff + (LANDING_CUTOFF - cutoff) * np.exp(-((distance / WIDTH_S) ** 4))
    return found
