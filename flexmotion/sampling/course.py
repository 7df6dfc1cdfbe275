"""`Course`: keeps what is asked straight, in its place, or turning as fast as it is asked, window by window.

A model's windows are right each by itself; small errors of their turning and place add up over minutes. The course
remembers heading and place, and asks the next window for a mean heading, and for a mean place, beside the words
(`Constraints.mean_heading`, `mean_place`): the motion remains one that the model makes. At a velocity that place is
where the velocity leads by then; words of walking, whose speed is the model's own, are asked for their line alone.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import atan2, cos, hypot, sin

import numpy as np
from numpy.typing import NDArray

from flexmotion.features.constraints import END, Constraints, end_mean
from flexmotion.features.decode import Anchor
from flexmotion.human.kinematics import foot_points
from flexmotion.human.motion import Motion
from flexmotion.sampling.sampler import Condition
from flexmotion.spatial.heading import continuous_heading, heading, wrapped

Float = NDArray[np.float64]
Velocity = tuple[float, float, float]

MEASURED_S = 32 / 30
"""Heading, place and velocity are means over this time, about one gait cycle: a walking pelvis turns by 5° to each
side within it [s]."""

MOST_TURNED, MOST_AWAY = np.radians(20.0), 0.1
"""Greatest error of the heading, and way to its place or line, that one window is asked to make up for [rad, m]. The
way is a step aside of a walker: with .2 m a walk is off its heading by up to 4.5°, with .1 m by 2."""

MOST_SWING = 0.2
"""Greatest difference of the mean headings of the end of a gait cycle and of all of it that is a pelvis's own [rad]."""

FARTHEST = np.pi - 0.3
"""A window is asked to turn by no more than this: further on, the other way round is nearer [rad]."""

CATCHING_UP, FASTER = 0.2, 0.4
"""Share of the sum of what a known speed lacked in all windows that is added to it, and the most [m/s]."""

RETURNED, FASTEST_RETURN = 2.0, 0.1
"""How many times the distance from its place a window in place is asked to make up for, and its greatest velocity
[m/s]. A model makes only a part of a small velocity: after ten minutes a stand is off by 9 cm with .5, by 4 with 2."""

RESTING = 0.1
"""The place of who stands is where the body came to rest: slower than this [m/s]."""

TRAVELLING = 0.25
"""Words of an unknown speed travel where the body is faster than this [m/s], else they are done in place."""

NEAR = 0.04
"""Within this of its place a motion of words of an unknown speed is asked for no velocity, which would hold the pelvis
of a gesture [m]."""

LOST = np.radians(45.0)
"""A heading that is off by more did not drift: the motion turns by itself (a dance), and its heading is the new one."""


@dataclass(frozen=True, eq=False)
class Course:
    """Heading and place of a motion; made once, then `followed` window by window.

    Attributes:
        led: headings to have had in the frames that are measured, (N,), up to the begin of the next window [rad]; None:
            not known yet.
        rate: turning of the last window that was asked for [rad/s].
        way: places to have had in those frames, (N, 2) [m]; None: the last window had no velocity to travel at.
        going: velocity of the last window in its own heading, forward and left [m/s].
        place: point of the line to walk along by words, beside the body, or where to stand, (2,) [m].
        direction: of travel, from the own heading [rad]; None in place.
        rested: whether who stands came to rest, at its place.
        slow: sum of what the speed of words lacked [m/s].
        stood: whether the body stood in the last window, and nothing was asked of its heading.
        settled: how far it has turned, over feet that stay, since nothing is asked of its heading [rad].
        frames: for which the request has been followed.
        request: what it is followed for.
    """

    led: Float | None = None
    rate: float = 0.0
    way: Float | None = None
    going: tuple[float, float] = (0.0, 0.0)
    place: tuple[float, float] = (0.0, 0.0)
    direction: float | None = None
    rested: bool = False
    slow: float = 0.0
    stood: bool = False
    settled: float = 0.0
    frames: int = 0
    request: Condition | None = None

    def followed(
        self,
        request: Condition,
        own: Velocity | None,
        past: Motion,
        free: Constraints,
        noise: float = 1.0,
        played: int | None = None,
    ) -> tuple[Course, Condition]:
        """The course after the next window, and what that window is to be asked for.

        Args:
            request: of the next window, as `Sampler.meant` gives it.
            own: velocity at which it is done: that of the request, or the one that its words are known for; None:
                unknown.
            past: the motion so far, at least `MEASURED_S` of it where it is that long.
            free: constraints of the model that ask for nothing.
            noise: of windows that are asked for a velocity, relative to others: with less of it their speed is nearer.
            played: frames of the last window that are part of the motion; None: all of it. Another target cuts it.
        """
        frames, measured = len(free.mask), _Measured.of(past)
        window, played = frames / past.fps, frames if played is None else played
        # Words of an unknown speed go at the one that is measured.
        going = own[:2] if own is not None else measured.velocity if measured.speed > TRAVELLING else (0.0, 0.0)
        rate = 0.0 if own is None else own[2]
        direction = atan2(going[1], going[0]) if hypot(*going) > 0 else None
        if direction is None:
            measured = replace(measured, place=_between_feet(past))
        course, led = self._led_to(measured, past.fps, played)
        way = self._way_to(past, played) if direction is not None and request.velocity is not None else None
        settled = self.settled + _turned_by(past, played) if self.stood else 0.0
        if self.led is None:  # a course begins where the body comes to rest, too
            settled = wrapped(Anchor.after(past).yaw - measured.heading)
        course = course._on(request, direction, measured, played)
        course = replace(course, led=led, rate=rate, way=way, going=going, stood=False, settled=settled)
        # Asked is the mean heading of the window's end, of a body that turns evenly from where it should be by now and
        # swings as it did.
        error = wrapped(float(led.mean()) - measured.heading)
        made_up = float(np.clip(error, -MOST_TURNED, MOST_TURNED))
        swing = float(np.clip(measured.later - (end_mean(led) - led.mean()), -MOST_SWING, MOST_SWING))
        anchor = Anchor.after(past)
        turn = wrapped(float(led[-1]) - anchor.yaw) - error + made_up + rate * window * (1 - END / 2) + swing
        asked = (request.constraints or free).mean_heading(float(np.clip(turn, -FARTHEST, FARTHEST)))
        more = np.zeros(2)
        if direction is None:
            course, more = course._back(measured, window)
            # Near its place a gesture is asked for no velocity: it would hold the pelvis.
            moves = not rate and (own is not None or float(np.hypot(*more)) > RETURNED * NEAR / window)
        else:
            moves = not rate or request.velocity is not None  # words of turning turn by themselves
            if way is not None:
                course, place = course._onward(measured, frames, past.fps)
                asked = asked.mean_place(_seen_from(anchor, place))
            elif not rate:
                course, place = course._beside(measured)
                asked = asked.mean_place(_seen_from(anchor, place), float(led[-1]) + direction - anchor.yaw)
            if own is not None and way is None:
                course, more = course._sped(measured, hypot(*going), played / frames)
        request = replace(request, constraints=asked)
        if not moves:
            return course, request
        velocity = (going[0] + float(more[0]), going[1] + float(more[1]), rate + made_up / window)
        return course, replace(request, asked=velocity, noise=noise)

    @property
    def heading(self) -> float | None:
        """To have where the next window begins [rad]; None: not known yet."""
        return None if self.led is None else float(self.led[-1])

    def _led_to(self, measured: _Measured, fps: float, played: int) -> tuple[Course, Float]:
        """The course, and the headings to have had in the last frames, of which so many belong to the last window."""
        course, led = self, self.led
        if led is not None:
            turned = led[-1] + self.rate / fps * np.arange(1, played + 1)
            led = np.concatenate([led, turned])[-len(led) :]
        if led is None or abs(wrapped(float(led.mean()) - measured.heading)) > LOST:
            course, led = Course(), np.full(round(MEASURED_S * fps), measured.heading)
        return course, led

    def _way_to(self, past: Motion, played: int) -> Float:
        """Places to have had in the last frames, (N, 2), with so many of the last window; begins at those that were."""
        measured = round(MEASURED_S * past.fps)
        if self.led is None or self.way is None:
            return past.root_position[-measured:, :2].copy()
        headings: Float = self.led[-1] + self.rate / past.fps * np.arange(1, played + 1)
        went = np.cumsum(_turned(self.going, headings), axis=0) / past.fps
        return np.concatenate([self.way, self.way[-1] + went])[-measured:]

    def _on(self, request: Condition, direction: float | None, measured: _Measured, played: int) -> Course:
        """The course for a request: the line of another one begins here, the heading stays."""
        if self.request == request and (direction is not None) == (self.direction is not None):
            return replace(self, frames=self.frames + played, direction=direction)
        fresh = Course(self.led, self.rate, self.way, self.going)
        return replace(fresh, place=measured.place, direction=direction, request=request)

    def _back(self, measured: _Measured, window: float) -> tuple[Course, Float]:
        """The course of who stands, and the velocity that leads to its place, (2,) [m/s].

        Who is asked for another place of its pelvis leans there; asked for a velocity, it steps.
        """
        course = self
        if not self.rested:
            course = replace(self, place=measured.place, rested=measured.speed <= RESTING)
        x, y = np.subtract(course.place, measured.place)
        c, s = cos(measured.heading), sin(measured.heading)
        more = RETURNED / window * np.array([c * x + s * y, -s * x + c * y])
        return course, more * min(1.0, FASTEST_RETURN / max(float(np.hypot(*more)), 1e-9))

    def _onward(self, measured: _Measured, frames: int, fps: float) -> tuple[Course, Float]:
        """The course at a velocity, and the place to be at in the mean of the next window's end, (2,) [m].

        A body that is further behind or ahead than a window makes up for does not hurry or wait afterwards; what it is
        aside of its way is made up for in several windows.
        """
        assert self.led is not None and self.way is not None and self.direction is not None
        angle = float(self.led[-1]) + self.direction
        ahead, left = np.array([cos(angle), sin(angle)]), np.array([-sin(angle), cos(angle)])
        off = np.asarray(measured.place) - self.way.mean(axis=0)
        along, across = _beyond(float(ahead @ off)), _beyond(float(left @ off))
        way = self.way + along * ahead
        headings: Float = self.led[-1] + self.rate / fps * np.arange(1, frames + 1)
        coming = way[-1] + np.cumsum(_turned(self.going, headings), axis=0) / fps
        return replace(self, way=way), end_mean(coming) + across * left

    def _beside(self, measured: _Measured) -> tuple[Course, Float]:
        """The course of words that travel, and a point of the line that the next window is asked to be on, (2,) [m]."""
        assert self.led is not None and self.direction is not None
        angle = float(self.led[-1]) + self.direction
        left, here = np.array([-sin(angle), cos(angle)]), np.asarray(measured.place)
        across = float(left @ (here - self.place))
        x, y = (float(value) for value in here - across * left)
        return replace(self, place=(x, y)), np.array([x, y]) + _beyond(across) * left

    def _sped(self, measured: _Measured, speed: float, share: float) -> tuple[Course, Float]:
        """The course, and the velocity on top that makes up for what a speed lacked, (2,) [m/s].

        Args:
            measured: of the motion so far.
            speed: to have [m/s].
            share: of the last window that was played: what is summed grows by as much.
        """
        assert self.led is not None and self.direction is not None
        ahead, slow = np.array([cos(self.direction), sin(self.direction)]), self.slow
        if self.frames >= len(self.led):  # else the speed before the request is measured too
            most = FASTER / CATCHING_UP
            slow = float(np.clip(slow + share * (speed - ahead @ measured.velocity), -most, most))
        return replace(self, slow=slow), CATCHING_UP * slow * ahead


def _beyond(off: float) -> float:
    """What of a distance is more than one window makes up for [m]."""
    return off - float(np.clip(off, -MOST_AWAY, MOST_AWAY))


def _seen_from(anchor: Anchor, place: Float) -> Float:
    """A place of the floor in the frame of a window, (2,) [m]."""
    found: Float = anchor.local(np.array([[*place, 0.0]]))[0, :2]
    return found


def _turned(going: tuple[float, float], headings: Float) -> Float:
    """A velocity in the own heading, at each heading (N,), in the world, (N, 2) [m/s]."""
    c, s = np.cos(headings), np.sin(headings)
    return np.stack([c * going[0] - s * going[1], s * going[0] + c * going[1]], axis=1)


def _turned_by(past: Motion, frames: int) -> float:
    """How far a body has turned in its last frames [rad]; what came before the motion is taken as even."""
    known = min(frames, len(past) - 1)
    if known < 1:
        return 0.0
    first, last = heading(past.root_quaternion[[-known - 1, -1]])
    return wrapped(float(last - first)) * frames / known


def _between_feet(past: Motion) -> tuple[float, float]:
    """Where a body stands, in the mean of the last `MEASURED_S` [m]: in a bow or a squat its pelvis is elsewhere."""
    last = past[max(0, len(past) - round(MEASURED_S * past.fps)) :]
    x, y = foot_points(last)[..., :2].mean(axis=(0, 1, 2)).tolist()
    return x, y


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
        later = float(end_mean(headings)) - heading
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
