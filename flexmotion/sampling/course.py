"""`Course`: keeps what is asked straight, in its place, or turning as fast as it is asked, window by window.

A model's windows are right each by itself; small errors of their turning and place add up over minutes. The course
remembers heading and place, and asks the next window for a mean heading, and for a mean place on its line, beside the
words (`Constraints.mean_heading`, `mean_place`): the motion remains one that the model makes.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import atan2, cos, hypot, sin

import numpy as np
from numpy.typing import NDArray

from flexmotion.features.constraints import END, Constraints, end_mean
from flexmotion.features.decode import Anchor
from flexmotion.human.motion import Motion
from flexmotion.sampling.sampler import Condition
from flexmotion.spatial.heading import continuous_heading, wrapped

Float = NDArray[np.float64]
Velocity = tuple[float, float, float]

MEASURED_S = 32 / 30
"""Heading, place and velocity are means over this time, about one gait cycle: a walking pelvis turns by 5° to each
side within it [s]."""

MOST_TURNED, MOST_ASIDE = np.radians(20.0), 0.1
"""Greatest change of heading, and way to its line, that one window is asked for [rad, m]: a step aside of who walks. Of
.2 m and more the walk's heading suffers (2 to 4.5°)."""

MOST_LATER = 0.2
"""Greatest difference of the mean headings of the end of a gait cycle and of all of it that is a pelvis's own [rad]."""

SUMMED, MOST_SUM = 0.3, 1.0
"""Share of the sum of the ways to its line of a walk sideways that is asked for on top, and the most of that sum [m]: a
model that walks ahead meanwhile does so in every window."""

CATCHING_UP, FASTER = 0.1, 0.4
"""Share of the sum of what a known speed lacked in all windows that is added to it, and the most [m/s]."""

RETURNED, FASTEST_RETURN = 2.0, 0.1
"""How many times the distance from its place a window in place is asked to make up for, and its greatest velocity
[m/s]. A model does a part of a small velocity: who stands for ten minutes is off by 9 cm with .5, 4 with 2."""

RESTING = 0.1
"""The place of who stands is where the body came to rest: slower than this [m/s]."""

TRAVELLING = 0.25
"""Words of an unknown speed travel where the body is faster than this [m/s], else they are done in place."""

BAND, NEAR = np.radians(2.0), 0.04
"""Within this of its heading and place a motion of words of an unknown speed is left alone [rad, m]: most gestures
swing the pelvis, and a commanded velocity holds it."""

LOST = np.radians(45.0)
"""A heading that is off by more did not drift: the motion turns by itself (a dance), and its heading is the new one."""


@dataclass(frozen=True)
class Course:
    """Heading and place of a motion; made once, then `followed` window by window.

    Attributes:
        heading: to keep, or of a turn where it leads by the end of the next window, as a mean [rad]; None: not known.
        settled: whether the heading can be taken from the motion; it cannot in a turn, and right after it.
        place: point of the line to walk along, or where to stand, (2,) [m].
        direction: of travel, from the own heading [rad]; None in place.
        rested: whether who stands came to rest, at its place.
        aside: sum of the ways to the line that a walk sideways was off it [m].
        slow: sum of what the speed lacked [m/s].
        request: what it is followed for.
    """

    heading: float | None = None
    settled: bool = True
    place: tuple[float, float] = (0.0, 0.0)
    direction: float | None = None
    rested: bool = False
    aside: float = 0.0
    slow: float = 0.0
    request: Condition | None = None

    def followed(
        self,
        request: Condition,
        own: Velocity | None,
        past: Motion,
        seconds: float,
        free: Constraints,
        noise: float = 1.0,
    ) -> tuple[Course, Condition]:
        """The course after the next window, and what that window is to be asked for.

        Args:
            request: of the next window, as `Sampler.meant` gives it.
            own: velocity at which it is done: that of the request, or the one that its words are known for; None:
                unknown.
            past: the motion so far, at least `MEASURED_S` of it where it is that long.
            seconds: length of a window.
            free: constraints of the model that ask for nothing.
            noise: of windows that are asked for a velocity, relative to others: with less of it their speed is nearer.
        """
        measured = _Measured.of(past)
        if own is not None and own[2]:
            return self._turned(request, own[2] * seconds, measured, past, free)
        if not self.settled:
            return Course(), request
        # Words of an unknown speed go at the one that is measured.
        going = own[:2] if own is not None else measured.velocity if measured.speed > TRAVELLING else (0.0, 0.0)
        direction = atan2(going[1], going[0]) if hypot(*going) > 0 else None
        course, heading = self._on(request, direction, measured)
        error = wrapped(heading - measured.heading)
        away = course._away(measured) if direction is None else np.zeros(2)
        if own is None and direction is None and abs(error) < BAND and float(np.hypot(*away)) < NEAR:
            return course, request
        turned, anchor = float(np.clip(error, -MOST_TURNED, MOST_TURNED)), Anchor.after(past)
        asked = request.constraints or free
        asked = asked.mean_heading(wrapped(measured.heading + turned + measured.later - anchor.yaw))
        more = np.zeros(2)
        if direction is None:
            # Who is asked for another place of its pelvis leans there; asked for a velocity, it steps.
            more = RETURNED * away / seconds
            more = more * min(1.0, FASTEST_RETURN / max(float(np.hypot(*more)), 1e-9))
        else:
            sideways = abs(going[1]) > abs(going[0])
            course, line = course._led(measured, sideways=sideways)
            place = anchor.local(np.array([[*line, 0.0]]))[0, :2]
            asked = asked.mean_place(place, heading + direction - anchor.yaw)
            # Sideways models are slow whatever they are asked for, and walk ahead where they are asked for more.
            if own is not None and not sideways:
                course, more = course._sped(measured, hypot(*going))
        velocity = (going[0] + float(more[0]), going[1] + float(more[1]), turned / seconds)
        return course, replace(request, asked=velocity, noise=noise, constraints=asked)

    def _sped(self, measured: _Measured, speed: float) -> tuple[Course, Float]:
        """The course, and the velocity on top that makes up for what a speed lacked, (2,) [m/s]."""
        assert self.direction is not None
        ahead, most = np.array([cos(self.direction), sin(self.direction)]), FASTER / CATCHING_UP
        slow = float(np.clip(self.slow + speed - ahead @ measured.velocity, -most, most))
        return replace(self, slow=slow), CATCHING_UP * slow * ahead

    def _turned(
        self, request: Condition, turn: float, measured: _Measured, past: Motion, free: Constraints
    ) -> tuple[Course, Condition]:
        """The course and the request of a window that turns by an angle [rad]."""
        before = None if self.settled else self.heading
        begins, error = before is None, 0.0 if before is None else wrapped(before - measured.heading)
        known = measured.heading + float(np.clip(error, -MOST_TURNED, MOST_TURNED))
        # Who begins to turn is half a window behind who turns already, and the end of the last one does not show it.
        heading = known + (turn / 2 if begins else turn)
        later = measured.later + ((1 - END) / 2 * turn if begins else 0.0)
        asked = (request.constraints or free).mean_heading(wrapped(heading + later - Anchor.after(past).yaw))
        return Course(heading=wrapped(heading), settled=False), replace(request, constraints=asked)

    def _led(self, measured: _Measured, *, sideways: bool) -> tuple[Course, Float]:
        """The course, and a place of the line that the next window is to be on, (2,) [m]."""
        assert self.heading is not None and self.direction is not None
        angle = self.heading + self.direction
        left = np.array([-sin(angle), cos(angle)])
        across = float(left @ np.subtract(measured.place, self.place))
        step, course = float(np.clip(across, -MOST_ASIDE, MOST_ASIDE)), self
        if sideways:
            aside = float(np.clip(self.aside + step, -MOST_SUM, MOST_SUM))
            course, step = replace(self, aside=aside), step + SUMMED * aside
        return course, np.asarray(measured.place) - step * left

    def _on(self, request: Condition, direction: float | None, measured: _Measured) -> tuple[Course, float]:
        """The course for a request, and its heading: the line of another one begins here, the heading stays."""
        course, heading = self, self.heading
        if heading is None or abs(wrapped(heading - measured.heading)) > LOST:
            heading = measured.heading
            course = Course(heading=heading)
        travels = direction is not None
        same = course.request == request and travels == (course.direction is not None)
        if not same and self._goes_on(request):
            # At another speed the line stays where its direction does.
            keeps = direction == course.direction
            place, aside = (course.place, course.aside) if keeps else (measured.place, 0.0)
            course = replace(course, place=place, aside=aside, slow=0.0, request=request)
        elif not same:
            course = replace(course, place=measured.place, rested=False, aside=0.0, slow=0.0, request=request)
        if not travels and not course.rested:
            course = replace(course, place=measured.place, rested=measured.speed <= RESTING)
        return replace(course, direction=direction), heading

    def _goes_on(self, request: Condition) -> bool:
        """Whether a request is the one before at another velocity."""
        before = self.request
        if before is None or before.velocity is None or request.velocity is None:
            return False
        return replace(before, velocity=None, pace=None) == replace(request, velocity=None, pace=None)

    def _away(self, measured: _Measured) -> Float:
        """From the body to its place, in its own heading, (2,) [m]."""
        x, y = np.subtract(self.place, measured.place)
        c, s = cos(measured.heading), sin(measured.heading)
        return np.array([c * x + s * y, -s * x + c * y])


@dataclass(frozen=True)
class _Measured:
    """Means over the last `MEASURED_S`: heading [rad], place [m], velocity in the own heading [m/s].

    Attributes:
        later: how far the heading of the end of that time is from that of all of it [rad]: the pelvis turns with each
            step, and a window is asked for the mean of its end.
    """

    heading: float
    later: float
    place: tuple[float, float]
    velocity: tuple[float, float]

    @classmethod
    def of(cls, past: Motion) -> _Measured:
        last = past[max(0, len(past) - round(MEASURED_S * past.fps)) :]
        headings = continuous_heading(last.root_quaternion)
        heading = float(headings.mean())
        later = float(np.clip(end_mean(headings) - heading, -MOST_LATER, MOST_LATER))
        x, y = (float(value) for value in last.root_position[:, :2].mean(axis=0))
        moved = last.root_position[-1, :2] - last.root_position[0, :2]
        along = moved * last.fps / max(len(last) - 1, 1)
        c, s = cos(heading), sin(heading)
        velocity = (float(c * along[0] + s * along[1]), float(-s * along[0] + c * along[1]))
        return cls(heading, later, (x, y), velocity)

    @property
    def speed(self) -> float:
        """[m/s]."""
        return hypot(*self.velocity)
