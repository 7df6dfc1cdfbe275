"""`Course`: keeps what is asked without a turn straight, and who stands in place, by what each window is asked for.

A model's windows are right each by itself; small errors of their turning and place add up over minutes. The course
remembers heading and place, and asks the next window for the velocity that makes up for what the last ones are off:
feedback through the model's own input, so that the motion remains one that the model makes.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import atan2, cos, hypot, sin

import numpy as np
from numpy.typing import NDArray

from flexmotion.human.motion import Motion
from flexmotion.sampling.sampler import Condition
from flexmotion.spatial.heading import continuous_heading, wrapped

Float = NDArray[np.float64]
Velocity = tuple[float, float, float]

MEASURED_S = 32 / 30
"""Heading, place and velocity are means over this time, about one gait cycle: a walking pelvis turns by 5° to each
side within it [s]."""

PROPORTIONAL, INTEGRAL, DAMPING = 0.8, 0.12, 1.0
"""Share of the heading's error, and of the sum of the errors of all windows, that one window is to make up for. The
measured heading is half a window old and the model does about what it is asked for: with the whole error in every
window the loop would be at the limit of stability, with half of it its error falls to a third in four windows."""

MOST_TURNING = 0.35
"""Greatest correction of turning [rad/s]."""

STEERED, AHEAD = np.radians(2.0), 2.0
"""A path beside its line is led back by turning the heading up to the first [rad], fully where it is off by about the
second times that [m] (line-of-sight guidance: Fossen, Handbook of Marine Craft Hydrodynamics, 2011, 12.3)."""

CATCHING_UP, FASTER = 0.1, 0.4
"""Share of the sum of what a known speed lacked in all windows that is added to it, and the most [m/s]."""

RETURNED, FASTEST_RETURN = 0.5, 0.1
"""Share of the distance from the place that a window in place makes up for, and its greatest velocity [m/s]."""

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
    """Heading and place of a motion that was asked for without a turn; made once, then `followed` window by window.

    Attributes:
        heading: to keep [rad]; None: not known yet.
        settled: whether the heading can be taken from the motion; it cannot right after a turn.
        place: point of the line to walk along, or where to stand, (2,) [m].
        direction: of travel, from the own heading [rad]; None in place.
        summed: sum of the heading's errors [rad].
        slow: sum of what the speed lacked [m/s].
        last: heading before the last window [rad]; None: not measured.
        request: what it is followed for.
    """

    heading: float | None = None
    settled: bool = True
    place: tuple[float, float] = (0.0, 0.0)
    direction: float | None = None
    summed: float = 0.0
    slow: float = 0.0
    last: float | None = None
    request: Condition | None = None

    def followed(
        self, request: Condition, own: Velocity | None, past: Motion, seconds: float, noise: float = 1.0
    ) -> tuple[Course, Condition]:
        """The course after the next window, and what that window is to be asked for.

        Args:
            request: of the next window, as `Sampler.meant` gives it.
            own: velocity at which it is done: that of the request, or the one that its words are known for; None:
                unknown.
            past: the motion so far, at least `MEASURED_S` of it where it is that long.
            seconds: length of a window.
            noise: of windows on a course, relative to others: what one window turns by chance, no feedback takes back.
        """
        if own is not None and own[2]:
            return Course(settled=False), request
        if not self.settled:
            return Course(), request
        measured = _Measured.of(past)
        known = own is not None
        if own is None:
            own = (*measured.velocity, 0.0) if measured.speed > TRAVELLING else (0.0, 0.0, 0.0)
        direction = atan2(own[1], own[0]) if hypot(own[0], own[1]) > 0 else None
        course = self._on(request, direction, measured)
        assert course.heading is not None
        across = course._across(measured) if direction is not None else 0.0
        error = wrapped(course.heading - measured.heading)
        steered = wrapped(error - float(np.clip(across / AHEAD, -STEERED, STEERED)))
        away = course._away(measured) if direction is None else np.zeros(2)
        if not known and abs(error) < BAND and float(np.hypot(*away)) < NEAR:
            return course, request
        most = MOST_TURNING * seconds / INTEGRAL  # the sum alone never asks for more
        course = replace(course, summed=float(np.clip(course.summed + steered, -most, most)))
        turned = 0.0 if self.last is None else wrapped(measured.heading - self.last)
        course = replace(course, last=measured.heading)
        turning = (PROPORTIONAL * steered + INTEGRAL * course.summed - DAMPING * turned) / seconds
        back = RETURNED * away / seconds
        back = back * min(1.0, FASTEST_RETURN / max(float(np.hypot(*back)), 1e-9))
        turning = float(np.clip(turning, -MOST_TURNING, MOST_TURNING))
        request = replace(request, noise=noise)
        if direction is not None and abs(own[1]) > abs(own[0]):
            # Sideways models are slow whatever they are asked for: only ahead of its line or behind is made up for.
            ahead = float(np.clip(RETURNED * across / seconds, -FASTER, FASTER))
            back = ahead * np.array([sin(direction), -cos(direction)])
        elif known and direction is not None:
            along = float(np.dot(measured.velocity, (cos(direction), sin(direction))))
            most = FASTER / CATCHING_UP
            slow = float(np.clip(course.slow + hypot(own[0], own[1]) - along, -most, most))
            course = replace(course, slow=slow)
            back = back + CATCHING_UP * slow * np.array([cos(direction), sin(direction)])
        return course, replace(request, asked=(own[0] + float(back[0]), own[1] + float(back[1]), turning))

    def _on(self, request: Condition, direction: float | None, measured: _Measured) -> Course:
        """The course for a request: the line of another one begins here, the heading stays."""
        course = self
        if course.heading is None or abs(wrapped(course.heading - measured.heading)) > LOST:
            course = Course(heading=measured.heading)
        travels = direction is not None
        same = course.request == request and travels == (course.direction is not None)
        if not same and self._goes_on(request):
            # At another speed: what the turning needs stays, and the line where its direction does.
            place = course.place if direction == course.direction else measured.place
            course = replace(course, place=place, slow=0.0, request=request)
        elif not same:
            course = replace(course, place=measured.place, summed=0.0, slow=0.0, request=request)
        elif not travels and measured.speed > RESTING:
            course = replace(course, place=measured.place)
        return replace(course, direction=direction)

    def _goes_on(self, request: Condition) -> bool:
        """Whether a request is the one before at another velocity."""
        before = self.request
        if before is None or before.velocity is None or request.velocity is None:
            return False
        return replace(before, velocity=None, pace=None) == replace(request, velocity=None, pace=None)

    def _across(self, measured: _Measured) -> float:
        """Distance to the left of the line [m]."""
        assert self.heading is not None and self.direction is not None
        angle = self.heading + self.direction
        x, y = np.subtract(measured.place, self.place)
        return float(-sin(angle) * x + cos(angle) * y)

    def _away(self, measured: _Measured) -> Float:
        """From the body to its place, in its own heading, (2,) [m]."""
        x, y = np.subtract(self.place, measured.place)
        c, s = cos(measured.heading), sin(measured.heading)
        return np.array([c * x + s * y, -s * x + c * y])


@dataclass(frozen=True)
class _Measured:
    """Means over the last `MEASURED_S`: heading [rad], place [m], velocity in the own heading [m/s]."""

    heading: float
    place: tuple[float, float]
    velocity: tuple[float, float]

    @classmethod
    def of(cls, past: Motion) -> _Measured:
        last = past[max(0, len(past) - round(MEASURED_S * past.fps)) :]
        heading = float(continuous_heading(last.root_quaternion).mean())
        x, y = (float(value) for value in last.root_position[:, :2].mean(axis=0))
        moved = last.root_position[-1, :2] - last.root_position[0, :2]
        along = moved * last.fps / max(len(last) - 1, 1)
        c, s = cos(heading), sin(heading)
        velocity = (float(c * along[0] + s * along[1]), float(-s * along[0] + c * along[1]))
        return cls(heading, (x, y), velocity)

    @property
    def speed(self) -> float:
        """[m/s]."""
        return hypot(*self.velocity)
