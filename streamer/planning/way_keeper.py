"""`WayKeeper`: which velocity the human is asked for, so that the robot does what it was asked to.

A model moves its human not exactly as asked, and a robot does not come as far as its human. The robot's odometry is
compared with the way that the asked velocity leads in its own heading, and what is missing is asked for in addition: a
proportional and integral loop on way and turn.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from flexmotion.sampling.pace import Pace
from flexmotion.streamer.motion.intents import Velocity

Float = NDArray[np.float64]

_BEGIN_S = 3.0
"""Until then the robot begins to move: the plan's lead, the first step, and half a window of the model [s]."""
_CHANGE_S = 2.0
"""Least time between two changes of what the human is asked for: about two windows of a model [s]."""
_GAIN, _INTEGRAL = 0.1, 0.01
"""Of what is missing [1/s], and of its integral [1/s²]. A request acts on windows not sampled yet: 3 s later."""
_MOST_S = 5.0
"""More than the way of this time is not made up for: a robot that was held up does not hurry afterwards [s]."""
_FASTEST = 1.5
"""What is asked of the human is within its pace times this: a robot that is slower than its human goes its fastest."""
_ACROSS = 1.0
"""Who moves sideways is kept from going ahead or back by at most this share of the asked speed."""


class WayKeeper:
    """Follows the odometry while one velocity is asked for.

    Args:
        wanted: the velocity that is asked for, of the human.
        pace: to which it is slowed; None: to none.
        scale: length of the human's legs over the robot's.
        place: odometry now: x, y [m], heading [rad], whole turns counted, (3,).
        time_s: now, on the clock of `update` [s].

    Attributes:
        wanted: as given.
        asked: what the human is asked for now.
    """

    def __init__(self, wanted: Velocity, pace: Pace | None, scale: float, place: Float, time_s: float) -> None:
        self.wanted = self.asked = wanted
        given = (wanted.forward, wanted.left, wanted.turning)
        self._wanted = np.array(given if pace is None else pace.slowed(given))
        self._pace, self._scale = pace, scale
        self._place, self._time_s = np.array(place, float), time_s
        self._begin_s = self._changed_s = time_s
        self._missing, self._sum = np.zeros(3), np.zeros(3)  # forward, left [m], turn [rad] of the human; and over time
        speed = math.hypot(*self._wanted[:2])
        aside = bool(self._wanted[1])
        self._kept = np.array([speed > 0.0, aside, bool(self._wanted[2])])
        self._speeds = np.array([speed, speed, abs(self._wanted[2])])

    def update(self, place: Float, time_s: float) -> Velocity | None:
        """Take a measurement; arguments as of the constructor.

        Returns:
            What the human is to be asked for from now on; None: it goes on.
        """
        moved, passed = np.array(place, float) - self._place, time_s - self._time_s
        middle = self._place[2] + 0.5 * moved[2]
        cosine, sine = math.cos(middle), math.sin(middle)
        done = np.array([cosine * moved[0] + sine * moved[1], cosine * moved[1] - sine * moved[0], moved[2]])
        self._place, self._time_s = np.array(place, float), time_s
        if passed <= 0.0:
            return None
        done[:2] *= self._scale
        most = _MOST_S * self._speeds
        self._missing = np.clip(self._missing + self._wanted * passed - done, -most, most) * self._kept
        limit = most / _INTEGRAL / _MOST_S
        self._sum = np.clip(self._sum + self._missing * passed, -limit, limit)
        if time_s - self._begin_s < _BEGIN_S or time_s - self._changed_s < _CHANGE_S:
            return None
        found = self._bounded(self._wanted + _GAIN * self._missing + _INTEGRAL * self._sum)
        self._changed_s = time_s
        forward, left, turning = map(float, found)
        self.asked = replace(self.wanted, forward=forward, left=left, turning=turning, paced=False)
        return self.asked

    def _bounded(self, velocity: Float) -> Float:
        """A velocity in the directions that were asked for, and not much beyond the pace."""
        found = np.where(self._kept, velocity, self._wanted)
        sign = np.sign(self._wanted)
        found = np.where(sign != 0.0, sign * np.maximum(sign * found, 0.0), found)
        if self._wanted[0] == 0.0:
            found[0] = np.clip(found[0], -_ACROSS * self._speeds[0], _ACROSS * self._speeds[0])
        if self._pace is None:
            return found
        pace = self._pace
        wider = Pace(_FASTEST * pace.ahead, _FASTEST * pace.back, _FASTEST * pace.aside, _FASTEST * pace.turning)
        forward, left, turning = map(float, found)
        return np.array(wider.slowed((forward, left, turning)))
