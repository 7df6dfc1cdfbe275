"""`WayKeeper`: which velocity the human is asked for, so that the robot does what it was asked to.

A model moves its human not exactly as asked, and a robot does not come as far as its human. What is asked of a model
acts on a window that is not sampled yet, about 3 s before the robot has done it. But what the robot does until then is
known: the human of the sampled frames is what it follows. So the loop is closed at their end: the robot's odometry, and
what the sampled human still does, are compared with the way that the asked velocity leads by then in the own heading.
What is missing there is asked of the next window in addition. A loop without a delay may be fast: no ratio of the model
or of the robot need be known. What is asked for over what is to be done is learnt, by an integral, within bounds.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from flexmotion.sampling.pace import Pace
from flexmotion.streamer.motion.intents import Velocity
from flexmotion.streamer.planning.human_ahead import MEAN_S, Coming

Float = NDArray[np.float64]

_EVERY_S = 0.25
"""Time between two changes of what the next window is asked for [s]: that of plans, which sample it."""
_LONGEST_S = 0.5
"""Of a longer time in which the human was not known, this counts [s]."""
_GAIN, _INTEGRAL = np.array([0.2, 0.2, 0.7]), np.array([0.02, 0.02, 0.06])
"""Of what is missing [1/s], and of its integral [1/s²], on the way ahead and aside, and on the turn.

A window is a second long: .7 takes back most of what is missing in one (sampled humans over 60 s looked 4.8° off in
curves at .3, 3.2 at .5, 2.4 at .7, rms of three seeds). On the way it is less: a robot that begins a second late is not
to hurry."""
_ACTS_S = 1.5
"""From this time on the robot does what is asked for: its way counts from its mean place in the gait cycle before, as a
torso sways [s]. A robot stands for .6 s after a stick is moved and has its speed after 1.4 (`robot/steering`, p50);
turns begin at once, and count. Counted from the begin, "slower" from .86 m/s of the human to .6 led to .49 for 4 s;
counted from one moment, a way ahead and aside was half a step off to the side."""
_LEAST, _MOST = 0.5, 2.0
"""Bounds of what is asked for over what is to be done, which the integral learns: a robot falls short of its human, and
slips beyond it."""
_NOTHING = 1e-3
"""Speeds up to this are none [m/s, rad/s]."""
_MOST_S = 5.0
"""More than the way of this time is not made up for: a robot that was held up does not hurry afterwards [s]."""
_FASTEST = 1.5
"""What is asked of the human is within its pace times this: a robot that is slower than its human goes its fastest."""
_ACROSS = 2.0
"""A human that steps aside is asked to go ahead or back, against the robot's drift, by at most this share of the asked
speed."""


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
        # Forward, left [m] and turn [rad] of the human: now, and at the last rows with their times.
        self._missing = np.zeros(3)
        # What has been learnt: what is asked for over what is to be done, and, where that is nothing, over time.
        self._ratio, self._sum = np.ones(3), np.zeros(3)
        self._recent: deque[tuple[float, Float]] = deque([(time_s, self._missing)])
        self._acts = False
        speed = math.hypot(*self._wanted[:2])
        aside = bool(self._wanted[1])
        self._kept = np.array([speed > 0.0, aside, bool(self._wanted[2])])
        self._speeds = np.array([speed, speed, abs(self._wanted[2])])
        self._does = np.abs(self._wanted) > _NOTHING

    def update(self, place: Float, time_s: float, ahead: Coming) -> Velocity | None:
        """Take a measurement.

        Args:
            place, time_s: as of the constructor.
            ahead: of the human that the robot follows, at the same time.

        Returns:
            What the human is to be asked for from the end of its sampled frames on; None: it goes on.
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
        self._recent.append((time_s, self._missing))
        while self._recent[0][0] < time_s - MEAN_S:
            self._recent.popleft()
        if not self._acts and time_s - self._begin_s >= _ACTS_S:
            self._acts = True
            self._count_from(np.mean([one for _, one in self._recent], axis=0) * [1.0, 1.0, 0.0])
        if time_s - self._changed_s < _EVERY_S or (coming := ahead.coming()) is None:
            return None
        since, self._changed_s = min(time_s - self._changed_s, _LONGEST_S), time_s
        seconds, does = coming
        missing = np.mean([one for _, one in self._recent], axis=0) + self._wanted * seconds - does
        missing = np.clip(missing, -most, most) * (self._kept & [self._acts, self._acts, True])
        held = (np.abs(missing) >= most) & self._does
        self._learn(np.where(held, 0.0, missing) * since)
        found = self._bounded(self._ratio * (self._wanted + _GAIN * missing) + _INTEGRAL * self._sum)
        forward, left, turning = map(float, found)
        self.asked = replace(self.wanted, forward=forward, left=left, turning=turning, paced=False)
        return self.asked

    def _count_from(self, missing: Float) -> None:
        """What is missing so far is not."""
        self._missing = self._missing - missing
        self._recent = deque((at, one - missing) for at, one in self._recent)

    def _learn(self, missing: Float) -> None:
        """What is missing again and again is asked for in proportion to what is to be done, or, of nothing, added."""
        share = np.divide(_INTEGRAL * missing, self._wanted, out=np.zeros(3), where=self._does)
        self._ratio = np.clip(self._ratio + share, _LEAST, _MOST)
        limit = self._speeds / _INTEGRAL
        self._sum = np.where(self._does, 0.0, np.clip(self._sum + missing, -limit, limit))

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
