"""`PartPaths`: arms and head that go to given joint angles at a given time, whatever the human does.

A path leads from where the joint is, and moves, to its goal, at rest there when it is due: its speed rises, stays and
falls as smoothly as the time allows. It is part of the retargeter's state, in ticks of the loop: later plans continue
it exactly. After its time the joint fades back to the human, or to the stand pose where the robot stands.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexmotion.configs.errors import RetargetError
from flexmotion.configs.get_up import MINIMUM_JERK_PEAK
from flexmotion.retarget.smoothing import Follower
from flexmotion.retarget.state import RetargetState
from flexmotion.retarget.whole_body import POSTURE
from flexmotion.spatial.transitions import minimum_jerk

Float = NDArray[np.float64]

FADE_S = 0.8
"""Least time in which a joint goes back to the human, or to the stand pose [s]."""
LONGEST_FADE_S = 2.5
"""Greatest one of arms and head, with the time until the filter is there [s]."""
_SETTLE_S = 0.4
"""Time that the filter has after that until it is there: eight of its time constants [s]."""
_SHARE = 0.9
"""Share of the filter's bounds on speed and acceleration that a path uses: the rest is left to `ArmGuard`."""
_LONGER, _HALVINGS = 1.05, 3
"""Ratio of the times that are tried, one after the other, for a path that would be too fast; and how often the last
step is halved: 5 % of a second are 3 cm of a fast hand."""
_SHORTEST_S = 0.08
"""Shortest path [s]."""
_RISES = np.linspace(0.5, 0.2, 7)
"""Shares of a path's time in which its speed rises, and in which it falls: the longer the smoother, the shorter the
slower at its fastest."""


_TRUNK = slice(0, len(POSTURE))
_HALTED = -1.0
"""Number of the path of a trunk that a stop has ended."""
_HALT_S = 0.2
"""Time in which it comes to rest [s]: from .22 m/s and 1.3 rad/s, the fastest, with 1.7 m/s² and 10 rad/s²."""


@dataclass(frozen=True)
class PartGoal:
    """Where some joints of arms and head are to be, or the trunk's posture.

    Attributes:
        number: of the goal, above 0; plans that are given the same number and angles go on with the same path.
        channels: of the filter, (K,).
        angles: there [rad], (K,).
        due: tick at which they are reached, or as soon after it as speed and acceleration allow.
        until: tick until which they are held; infinite: until it is no goal any more.
        acceleration: bounds on the way there below those of the filter, as of a joint whose torque is capped, (K,)
            [rad/s²]; None: those of the filter.
        least_s, back_s: least time of the way there, and of the way back [s].

    Raises:
        RetargetError: a value is not a number, or there is not one angle for each channel.
    """

    number: int
    channels: NDArray[np.int64]
    angles: Float
    due: float
    until: float
    acceleration: Float | None = None
    least_s: float = 0.0
    back_s: float = 0.0

    def __post_init__(self) -> None:
        if self.angles.shape != self.channels.shape or not np.isfinite(self.angles).all():
            found = ", ".join(f"{angle:g}" for angle in self.angles) or "none"
            raise RetargetError(
                f"goal {self.number}: angles: expected {len(self.channels)} finite numbers [rad]; found {found}"
            )
        if not (np.isfinite(self.due) and self.until >= self.due):
            raise RetargetError(
                f"goal {self.number}: expected a finite tick due, and one until which it holds at or after it; found "
                f"{self.due:g} and {self.until:g}"
            )


@dataclass(frozen=True)
class PartGoals:
    """What arms, head and trunk are to do.

    Attributes:
        goals: that hold; no channel is in two of them. Joints of others go back.
        ended: a stop has ended the goals up to this number: their joints of arms and head stay where they are.
        halts: a stop has ended a goal of the trunk, which stays where that has met it. It would else go on to the stand
            pose, as every stop that is no path does.
    """

    goals: Sequence[PartGoal] = ()
    ended: float = 0.0
    halts: bool = False


NO_PARTS, STOPPED_PARTS = PartGoals(), PartGoals(ended=np.inf, halts=True)


class PartPaths:
    """Paths of the channels of one robot's filter.

    Args:
        follower: the filter, which a path passes unchanged.
        rest: angles of its channels in the stand pose, (C,).
    """

    def __init__(self, follower: Follower, rest: Float) -> None:
        self._follower, self._rest = follower, rest
        self._rate = 1.0 / follower.dt

    def update(self, state: RetargetState, parts: PartGoals, tick: int) -> None:
        """Begin the paths to goals that are new, and let those go that are not among the goals any more.

        Args:
            state: where a plan resumes; its paths are written.
            parts: what is to be done.
            tick: at which the plan begins.
        """
        ended = state.part <= parts.ended
        ended[_TRUNK] = False
        state.part[ended], state.part_until[ended] = 0.0, -np.inf
        goals = parts.goals
        if parts.halts:
            self._halt(state, tick)
        kept = [goal.number for goal in goals] + ([_HALTED] if parts.halts else [])
        gone = (state.part != 0) & ~np.isin(state.part, kept)
        state.part_until[gone] = np.minimum(state.part_until[gone], tick)
        for goal in goals:
            own = goal.channels
            if (state.part[own] == goal.number).all() and (state.part_to[own] == goal.angles).all():
                continue
            begin, speed = state.position[own], state.velocity[own]
            state.part_bound[own] = np.inf if goal.acceleration is None else goal.acceleration
            bound = np.minimum(self._follower.acceleration, state.part_bound)[own]
            asked = max(goal.due - tick, goal.least_s * self._rate)
            ticks = self._ticks(own, begin, speed, goal.angles, asked, bound)
            state.part[own] = goal.number
            state.part_from[own], state.part_speed[own], state.part_to[own] = begin, speed, goal.angles
            state.part_begins[own], state.part_due[own] = tick, tick + ticks
            state.part_until[own], state.part_back[own] = max(goal.until, tick + ticks), goal.back_s

    def _halt(self, state: RetargetState, tick: int) -> None:
        """Bring a trunk that follows a path to rest, and let it stay there; one that is nearly there arrives."""
        own = np.arange(len(POSTURE))
        rests = (state.part[own] == _HALTED) & np.isposinf(state.part_until[own])
        if rests.all() or not self.led(state, tick)[own].all():
            return
        coming = 0.0 <= float(state.part_due[0]) - tick < _HALT_S * self._rate
        state.part[own], state.part_until[own] = _HALTED, np.inf
        if coming:
            return
        state.part_from[own], state.part_speed[own] = state.position[own], state.velocity[own]
        state.part_to[own] = state.position[own] + 0.5 * _HALT_S * state.velocity[own]
        state.part_begins[own], state.part_due[own] = tick, tick + _HALT_S * self._rate

    def lead(self, state: RetargetState, targets: Float, tick: int, *, stands: bool) -> Float:
        """Targets of the filter with the channels that follow a path replaced, (T, C).

        Args:
            targets: of the filter from `tick` on, (T, C).
            stands: no human is followed: arms and head go back to the stand pose.
        """
        ticks = tick + np.arange(len(targets), dtype=float)
        led = np.flatnonzero(self.led(state, tick))
        if not len(led):
            return targets
        fades, targets = self._fades(state), targets.copy()
        for channel in map(int, led):
            back = minimum_jerk((ticks - state.part_until[channel]) / fades[channel])
            base = self._rest[channel] if stands and channel >= len(POSTURE) else targets[:, channel]
            targets[:, channel] = (1.0 - back) * self._path(state, channel, ticks) + back * base
        return targets

    def led(self, state: RetargetState, tick: float) -> NDArray[np.bool_]:
        """Which channels follow a path from a tick on, under way or held, (C,)."""
        if np.isneginf(state.part_until).all():  # most plans lead nothing
            return np.zeros(state.part_until.shape, np.bool_)
        return np.asarray(state.part_until + self._fades(state) + _SETTLE_S * self._rate > tick, dtype=np.bool_)

    def moves(self, state: RetargetState, tick: float) -> bool:
        """Whether a joint is under way to its goal, or back from it, at a tick or soon after it."""
        if not state.part.any():  # most plans lead nothing
            return False
        settle = _SETTLE_S * self._rate
        coming = tick < state.part_due + settle
        going = (tick + settle >= state.part_until) & (tick < state.part_until + self._fades(state) + settle)
        return bool(((state.part != 0) & (coming | going)).any())

    def upright(self, state: RetargetState, tick: float) -> float:
        """Tick from which hips and trunk follow no path of their own: infinite while they hold a place."""
        if not self.led(state, tick)[0]:
            return -np.inf
        until = float(state.part_until[0])
        return np.inf if until > tick else until + float(self._fades(state)[0])

    def _fades(self, state: RetargetState) -> Float:
        """Ticks in which each channel goes back, (C,): by minimum jerk to the stand pose within the bounds.

        The greatest speed of such a way is 15/8 of its mean, the greatest acceleration 10/√3 of way over time squared.
        """
        way = np.abs(state.part_to - self._rest)
        way[POSTURE.index("yaw")] = 0.0  # it is that of the feet, on the way there and back
        seconds = np.maximum(
            MINIMUM_JERK_PEAK * way / (_SHARE * self._follower.speed),
            np.sqrt(10.0 / np.sqrt(3.0) * way / (_SHARE * np.minimum(self._follower.acceleration, state.part_bound))),
        )
        # The bounds are those of a smooth way; what the legs' servos need on it is judged elsewhere, and is never cut.
        seconds = np.maximum(np.clip(seconds, FADE_S, LONGEST_FADE_S - _SETTLE_S), state.part_back)
        for number in np.unique(state.part[state.part != 0]):
            own = state.part == number
            seconds[own] = seconds[own].max()
        return seconds * self._rate

    def _path(self, state: RetargetState, channel: int, ticks: Float) -> Float:
        """Targets for which the filter's output is the path, (T,)."""
        begins, due = state.part_begins[channel], state.part_due[channel]
        seconds = (due - begins) / self._rate
        way, speed = state.part_to[channel] - state.part_from[channel], state.part_speed[channel] * seconds
        rise, _ = self._rises(np.array([channel]), np.array([way]), np.array([speed]), seconds)
        # From the row before the first one on; a row's place is that at its end.
        line = np.concatenate([ticks[:1] - 1.0, ticks[:1], ticks + 1.0])
        places = state.part_from[channel] + path_places((line - begins) / (due - begins), way, speed, float(rise[0]))
        return self._follower.passing(places, channel)

    def _ticks(
        self, channels: NDArray[np.int64], begin: Float, speed: Float, goal: Float, asked: float, bound: Float
    ) -> float:
        """Ticks of a path: as asked, or the least within the bounds; `bound`: of its acceleration, (K,) [rad/s²]."""

        def fits(ticks: float) -> bool:
            seconds = ticks / self._rate
            return bool(self._rises(channels, goal - begin, speed * seconds, seconds, bound)[1].all())

        ticks = short = max(asked, _SHORTEST_S * self._rate)
        while not fits(ticks):
            short, ticks = ticks, _LONGER * ticks
        for _ in range(_HALVINGS if ticks > short else 0):
            middle = 0.5 * (short + ticks)
            short, ticks = (short, middle) if fits(middle) else (middle, ticks)
        return ticks

    def _rises(
        self, channels: NDArray[np.int64], way: Float, speed: Float, seconds: float, acceleration: Float | None = None
    ) -> tuple[Float, NDArray[np.bool_]]:
        """Share of a path's time in which the speed of each channel rises, and whether that is within the bounds, (K,).

        Args:
            way, speed: of each channel, the speed at its begin by the path's time, (K,) [rad].
            acceleration: bounds of each channel, (K,) [rad/s²]; None: those of the filter.
        """
        fastest = _SHARE * self._follower.speed[channels] * seconds
        bound = self._follower.acceleration[channels] if acceleration is None else acceleration
        hardest = _SHARE * bound * seconds**2
        top = _top(way, speed, _RISES[:, None])
        # A joint that is faster than that already is not asked to be slower at once.
        slow = np.abs(top) <= np.maximum(fastest, np.abs(speed))
        bend = 1.5 / _RISES[:, None] * np.maximum(np.abs(top - speed), np.abs(top))
        fits: NDArray[np.bool_] = slow & (bend <= hardest)
        return _RISES[fits.argmax(axis=0)], np.asarray(fits.any(axis=0), dtype=np.bool_)


def _top(way: Any, speed: Any, rise: Any) -> Any:
    """The speed between rise and fall, for which the path ends at `way`; arguments of `path_places`."""
    return (way - 0.5 * rise * speed) / (1.0 - rise)


def path_places(share: Float, way: float, speed: float, rise: float) -> Float:
    """Places on a path that takes a time of 1: from 0, at a speed, to `way`, at rest, (T,).

    Its speed changes by a smoothstep to another, stays, and falls by a smoothstep.

    Args:
        share: of the time, (T,), from before its begin to after its end; rise: of it in which the speed changes, and in
            which it falls, .5 at most.
    """
    top = float(_top(way, speed, rise))
    before, share = np.minimum(share, 0.0), np.clip(share, 0.0, 1.0)
    begin, end = np.minimum(share / rise, 1.0), np.minimum((1.0 - share) / rise, 1.0)
    # u³ - u⁴/2 is the integral of the smoothstep 3 u² - 2 u³.
    first = speed * np.minimum(share, rise) + (top - speed) * rise * begin**3 * (1.0 - 0.5 * begin)
    last = top * rise * (0.5 - end**3 * (1.0 - 0.5 * end))
    places: Float = speed * before + first + top * np.clip(share - rise, 0.0, 1.0 - 2.0 * rise) + last
    return places
