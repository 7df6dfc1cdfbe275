"""`StraightHeading`: how far a robot that is to go straight would look aside, were its heading that of its human.

A model's human that walks straight, or aside, keeps its heading in the mean over seconds (`sampling/course.py`), and
looks aside by up to 20° within one. But its heading is known before the robot takes it over: what it is aside is taken
off where the next plan turns the human's heading into the robot's.
"""

from __future__ import annotations

import math

from flexmotion.streamer.planning.human_ahead import Looking

_AHEAD_S = 0.6
"""A change of a plan's heading acts on feet that land from here on: a step's notice and half a swing later [s]."""
_EVERY_S = 0.1
"""Time between two looks at the human [s]."""
_INTEGRAL = 0.1
"""Of what the robot looks aside by its odometry, against what it looks aside of its human [1/s]."""
_MOST_OWN = 0.1
"""Most of that [rad]."""
MOST, FASTEST = 0.6, 0.3
"""What is taken off at most [rad], and how fast that changes [rad/s]: a human that steps aside looks up to 30° to a
side within 2 s. In the time between two plans it changes by less than what passes for a robot that was turned by hands
(`retarget/view.py`)."""


class StraightHeading:
    """Follows velocities without a turn, the next one after the last.

    Args:
        facing: heading of the robot in its odometry, which is kept [rad], whole turns counted.
        time_s: now, on the clock of `update` [s].
        aside: what is taken off already [rad].

    Attributes:
        aside: what is to be taken off the heading of the robot's human [rad], up to a constant.
    """

    def __init__(self, facing: float, time_s: float, aside: float = 0.0) -> None:
        self.aside = self._before = aside
        self._facing, self._time_s = facing, time_s
        self._straight = math.nan  # heading of the human at the beginning
        self._own = 0.0

    def update(self, facing: float, time_s: float, ahead: Looking) -> None:
        """Take a measurement; `ahead`: of the human that the robot follows, at the same time."""
        passed = time_s - self._time_s
        if passed < _EVERY_S or (heading := ahead.heading(_AHEAD_S)) is None:
            return
        self._time_s = time_s
        if math.isnan(self._straight):
            self._straight = heading
        error = math.remainder(facing - self._facing, math.tau)
        self._own = min(max(self._own + _INTEGRAL * error * passed, -_MOST_OWN), _MOST_OWN)
        wanders = math.remainder(heading - self._straight, math.tau)
        found = self._before + min(max(wanders + self._own, -MOST), MOST)
        most = FASTEST * passed
        self.aside += min(max(found - self.aside, -most), most)
