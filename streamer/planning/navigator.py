"""`Navigator`: which velocity brings the robot to a heading or a place in its odometry, as it measures itself.

A goal is approached in moves, each of which ends in a stand that is measured: turns on the spot, walks ahead with
corrections of the course, and near the goal short shifts and small turns. What is missing after one is the next.
"""

from __future__ import annotations

import copy
import math
from collections import deque
from dataclasses import dataclass, replace
from enum import Enum, auto

import numpy as np
from numpy.typing import NDArray

from flexmotion.retarget.footsteps import EXACT_YAW
from flexmotion.sampling.pace import Pace
from flexmotion.spatial.heading import wrapped
from flexmotion.streamer.motion.intents import SLOWEST_TURN, Goal, Heading, Intent, Text, Velocity, Waypoint
from flexmotion.streamer.motion.programs import Step
from flexmotion.streamer.planning.robot_size import RobotSize
from flexmotion.streamer.planning.standstill import Closing, Standstill

Float = NDArray[np.float64]

STANDING = Text("stand still")

TURNING = 0.5
"""Greatest turning speed of a turn, within the robot's pace [rad/s]."""
HEADING_TOLERANCE = 0.08
"""The robot looks where it should when it stands within this angle [rad]: the feet turn to within `EXACT_YAW` of where
the human looks, whose pelvis turns by some degrees until it stands."""
_WALKING = 0.8
"""Speed of the human of a walk, where the robot has no pace of its own [m/s]."""
_PIVOT_RAD = np.radians(25.0)
"""A place that lies further aside than this is turned to before it is walked to [rad]."""
_STEER_S, _STEER_GAIN, _STEER_MOST, _STEER_LEAST = 1.0, 0.6, 0.3, 0.1
"""Corrections of the course: time between two [s], turning speed per angle [1/s], its greatest value and the smallest
change that is worth a cut of the motion [rad/s]."""
_FACE_RAD, _FACE_S = np.radians(25.0), 2.0
"""A turn up to this angle is made by a standing human that looks there for this time: the feet follow [rad, s]."""
_LEAST_FACE_RAD = 1.5 * EXACT_YAW
"""The feet follow no smaller turn [rad]."""
_NO_STEP_RAD, _FURTHER_RAD = 0.5 * EXACT_YAW, EXACT_YAW
"""The robot made no step if it turned by less than the first; then the human looks aside by the second more [rad]."""
_COURSE_S = 1.0
"""The heading of a walk is its mean over this time [s]."""
_ATTEMPTS = 8
"""Moves towards a goal, turns and walks together."""
_GRACE_S = 40.0
"""Time for a goal beyond what its way and turn take at the robot's slowest [s]."""
_SLOWEST_RAD_S = 0.2
"""Turning speed for the time that a goal is given [rad/s]."""


class Phase(Enum):
    """What the robot does towards the goal."""

    TURN = auto()
    FACE = auto()
    WALK = auto()
    SETTLE = auto()
    OVER = auto()


@dataclass(frozen=True)
class Wound:
    """Turn on the spot to a heading with all its whole turns.

    Attributes:
        heading: in the odometry, whole turns counted [rad].
        turning: greatest turning speed [rad/s].
    """

    heading: float
    turning: float


class Navigator:
    """One goal. `update` with every measurement; it says what the human does.

    Args:
        goal: place or heading in the odometry; a heading is turned to the shorter way, but for one that is `Wound`.
        pace: greatest speeds of the human; None: no limit.
        place: odometry now: x, y [m], heading [rad], whole turns counted, (3,).
        time_s: now, on the clock of `update` [s].
        size: of the robot.
        manner: in which the human moves; None: the normal one.
        beside: gesture that it makes meanwhile; None: there is none.

    Attributes:
        phase: present phase; over: nothing more is done.
        move: velocity that the human is asked for; zero: it stands, turned by `facing`. None: the robot stands.
        arrived: whether it stands within the tolerance; meaningful once over.
        limit_s: the longest time that it takes [s].
    """

    def __init__(
        self,
        goal: Goal | Wound,
        pace: Pace | None,
        place: Float,
        time_s: float,
        size: RobotSize,
        *,
        manner: str | None = None,
        beside: Text | None = None,
    ) -> None:
        self.goal, self.pace, self.size, self.manner, self.beside = goal, pace, size, manner, beside
        self.move: Velocity | None = None
        self.arrived, self._looks = False, 0.0
        self._begin_s, self._attempts = time_s, 0
        self._heading = 0.0  # of the turn under way, whole turns counted
        self._along = np.zeros(2)  # direction of the walk
        self._steered_s = time_s
        self._recent: deque[tuple[float, float]] = deque()  # times and headings
        self._faced_from: float | None = None  # heading at which the human began to look aside
        self._bias = 0.0  # turn of the robot beyond that of the human that looked aside: its feet are not parallel
        self._closing = Closing()
        self._standstill: Standstill | None = None
        self.limit_s = _GRACE_S + self._distance(place) / size.slowest + math.tau / _SLOWEST_RAD_S
        self.phase = Phase.SETTLE
        self._decide(np.array(place, float), time_s)

    @property
    def over(self) -> bool:
        """Whether it has ended."""
        return self.phase is Phase.OVER

    @property
    def facing(self) -> float:
        """Angle by which a standing human looks to the left of the robot [rad]; 0 while none is asked to."""
        return self._looks if self.phase is Phase.FACE else 0.0

    @property
    def asked(self) -> Intent | None:
        """What the human does; None: nothing, the robot stands."""
        move = self.move
        if move is None:
            return None
        asked = move if any((move.forward, move.left, move.turning)) else STANDING
        return replace(asked, beside=self.beside)

    def at(self, turning: float) -> Navigator:
        """The same way at another turning speed [rad/s], from the turn under way on; where the goal is `Wound`."""
        assert isinstance(self.goal, Wound)
        other = copy.copy(self)
        other.goal = replace(self.goal, turning=max(abs(turning), SLOWEST_TURN))
        if self.phase is Phase.TURN and self.move is not None:
            other.move = replace(self.move, turning=math.copysign(other._fastest_turn, self.move.turning))
        return other

    def with_beside(self, gesture: Text | None) -> Navigator:
        """The same way with another gesture, or with none."""
        other = copy.copy(self)
        other.beside = gesture
        return other

    def update(self, place: Float, time_s: float) -> None:
        """Take a measurement: odometry as in the constructor, and its time [s]."""
        place = np.array(place, float)
        self._recent.append((time_s, float(place[2])))
        while self._recent[0][0] < time_s - _COURSE_S:
            self._recent.popleft()
        if self.phase is Phase.OVER:
            return
        if time_s - self._begin_s > self.limit_s:
            self._end(place, arrived=False)
        elif self.phase is Phase.TURN:
            assert self.move is not None
            side = math.copysign(1.0, self.move.turning)
            if self._closing.reached(side * (self._heading - place[2])):
                self._settle(place, time_s)
        elif self.phase is Phase.FACE:
            if time_s - self._steered_s >= _FACE_S:
                self._settle(place, time_s)
        elif self.phase is Phase.WALK:
            self._watch_walk(place, time_s)
        elif self._standstill is not None and self._standstill.settled(place, time_s):
            self._decide(place, time_s)

    def _decide(self, place: Float, time_s: float) -> None:
        """The next move of a robot that stands, or begins."""
        self._learn(place)
        missing = self._distance(place)
        near = missing <= (self.goal.tolerance if isinstance(self.goal, Waypoint) else 0.0)
        heading = self.goal.heading
        if near and (heading is None or abs(self._missing_turn(heading, place)) <= HEADING_TOLERANCE):
            self._end(place, arrived=True)
        elif self._attempts >= _ATTEMPTS:
            self._end(place, arrived=False)
        elif near:
            assert heading is not None
            self._turn(heading, place, time_s)
        else:
            bearing = self._bearing(place)
            if missing > self.size.near and abs(wrapped(bearing - place[2])) > _PIVOT_RAD:
                self._turn(bearing, place, time_s)
            else:
                self._walk(place, time_s)

    def _end(self, place: Float, *, arrived: bool) -> None:
        self.phase, self.move, self.arrived = Phase.OVER, None, arrived

    def _settle(self, place: Float, time_s: float) -> None:
        self.phase, self.move, self._standstill = Phase.SETTLE, None, Standstill(place, time_s, self.size)

    # ------------------------------------------------------------ turns

    def _turn(self, heading: float, place: Float, time_s: float) -> None:
        self._attempts += 1
        missing = self._missing_turn(heading, place)
        self._heading, self._steered_s = place[2] + missing, time_s
        if abs(missing) <= _FACE_RAD:
            self._faced_from = float(place[2])
            self._looks = math.copysign(max(abs(missing), _LEAST_FACE_RAD), missing) - self._bias
            self.phase, self.move = Phase.FACE, Velocity(0.0, 0.0, 0.0)
            return
        self.phase, self._closing = Phase.TURN, Closing()
        self.move = Velocity(0.0, 0.0, math.copysign(self._fastest_turn, missing), self.manner)

    @property
    def _fastest_turn(self) -> float:
        """Greatest turning speed of a turn to the goal [rad/s]."""
        fastest = TURNING if self.pace is None else min(TURNING, self.pace.turning)
        asked = self.goal.turning if isinstance(self.goal, Heading | Wound) else None
        return fastest if asked is None else min(fastest, asked)

    def _learn(self, place: Float) -> None:
        """Compare a turn made by a human that looked aside with what was meant.

        The robot's feet follow those of the human, which may point elsewhere than its pelvis.
        """
        if self._faced_from is None:
            return
        turned = float(place[2]) - self._faced_from
        self._faced_from = None
        if abs(turned) < _NO_STEP_RAD:
            self._bias -= math.copysign(_FURTHER_RAD, self._looks)
        else:
            self._bias = turned - self._looks

    # ------------------------------------------------------------ walks

    def _walk(self, place: Float, time_s: float) -> None:
        self._attempts += 1
        self.phase, self._steered_s = Phase.WALK, time_s
        away = self._away(place)
        self._along = away / np.linalg.norm(away)
        self._closing = Closing()
        self._recent.clear()
        self.move = self._towards(place)

    def _towards(self, place: Float) -> Velocity:
        """Velocity of the human towards the goal, in the direction in which the robot looks."""
        heading = float(np.mean([one for _, one in self._recent] or place[2]))
        bearing = wrapped(self._bearing(place) - heading)
        if abs(bearing) <= _PIVOT_RAD:
            turning = float(np.clip(_STEER_GAIN * bearing, -_STEER_MOST, _STEER_MOST))
            ahead = _WALKING if self.pace is None else self.pace.ahead
            return Velocity(ahead, 0.0, turning if self._distance(place) > self.size.near else 0.0)
        pace = Pace(_WALKING, _WALKING, _WALKING, TURNING) if self.pace is None else self.pace
        ahead, left = math.cos(bearing), math.sin(bearing)
        share = 1.0 / max(abs(ahead) / (pace.ahead if ahead > 0.0 else pace.back), abs(left) / pace.aside)
        return Velocity(share * ahead, share * left, 0.0)

    def _watch_walk(self, place: Float, time_s: float) -> None:
        missing = float(self._along @ self._away(place))
        if self._closing.reached(missing):
            self._settle(place, time_s)
            return
        if missing < self.size.near or time_s - self._steered_s < _STEER_S:
            return
        assert self.move is not None
        wanted = self._towards(place)
        if wanted.left == 0.0 and self.move.left == 0.0 and abs(wanted.turning - self.move.turning) >= _STEER_LEAST:
            away = self._away(place)
            self.move, self._steered_s, self._along = wanted, time_s, away / np.linalg.norm(away)

    # ------------------------------------------------------------ geometry

    def _missing_turn(self, heading: float, place: Float) -> float:
        missing = float(heading - place[2])
        return missing if isinstance(self.goal, Wound) else wrapped(missing)

    def _away(self, place: Float) -> Float:
        if not isinstance(self.goal, Waypoint):
            return np.zeros(2)
        return np.array([self.goal.x, self.goal.y]) - place[:2]

    def _distance(self, place: Float) -> float:
        return float(np.linalg.norm(self._away(place)))

    def _bearing(self, place: Float) -> float:
        x, y = self._away(place)
        return math.atan2(y, x)


def navigator_for(step: Step, pace: Pace | None, place: Float, time_s: float, size: RobotSize) -> Navigator | None:
    """The way to where a step ends in the odometry: its goal, or the heading after a measured turn.

    Args:
        step: of a program.
        pace, place, time_s, size: as of `Navigator`.

    Returns:
        None where the step does not say, or its model follows words alone.
    """
    manner = step.told.manner
    if step.goal is not None:
        return Navigator(step.goal, pace, place, time_s, size, manner=manner, beside=step.beside)
    if not step.is_led:
        return None
    assert step.amount is not None and isinstance(step.intent, Velocity)
    turning = max(abs(step.intent.turning), SLOWEST_TURN)
    goal = Wound(float(place[2]) + (step.turn or 1) * step.amount.value, turning)
    return Navigator(goal, pace, place, time_s, size, manner=manner, beside=step.beside)
