"""Steps at the robot's own cadence, for a robot that lags behind its human.

The robot's steps are too short to keep up with a fast or sideways walk, one step for each of the human's. While it
lags, it steps as soon as a foot is free, with the swings of its fastest walk, and lands with the human's foot where
that costs little. It makes up for its lag while the human is slower or waits.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import ceil, cos, hypot, isnan, pi, sin

import numpy as np
from numpy.typing import NDArray

from flexmotion.retarget.footholds import Footholds, ahead_of
from flexmotion.retarget.human import Swing
from flexmotion.retarget.step_timing import StepTiming
from flexmotion.retarget.view import HumanView

Float = NDArray[np.float64]

_LEAST_LAG = 0.2
"""A robot that is less behind its human than this keeps to the human's time; over its longest stride."""
_LAST_LAG = 0.5
"""The same once the human's frames have ended: the step that puts the feet side by side follows anyway."""
_LEAST_WAY = 0.4
"""A step of its own that lifts between the human's takes the foot at least so far; over its longest stride."""
_LEAST_ASIDE, _LEAST_ASIDE_WAY = 1.0, 0.4
"""Lag to the side, and way of a step that makes up for it, likewise; over the range of `gait.lateral`, which is what a
step out and a step after it get a robot aside."""
_HEADING_S = 0.0, 0.9
"""The human's heading that counts for a foot is the mean over this time after its landing [s]: the foot points there
for as long, and the pelvis oscillates once a stride. The torso twists over the feet to where the human looks now."""


@dataclass(frozen=True)
class OwnStep:
    """When a step of the robot's own cadence is made, and for what of the human's.

    Attributes:
        side: foot that moves, 0 left, 1 right.
        lift, land: loop ticks.
        land_s: source time of the landing [s].
        heading_s: source times between which the human's heading counts [s].
        consumed_s: source time up to which the human swings of this foot are used up.
    """

    side: int
    lift: int
    land: int
    land_s: float
    heading_s: tuple[float, float]
    consumed_s: float


class Cadence:
    """The own cadence of one robot.

    Args:
        footholds: of the robot.
        timing: of its steps.
    """

    def __init__(self, footholds: Footholds, timing: StepTiming) -> None:
        self.footholds, self.timing, self.swings = footholds, timing, footholds.swings
        stride = self.swings.longest_stride
        self.least_lag, self.last_lag, self.least_way = (
            share * stride for share in (_LEAST_LAG, _LAST_LAG, _LEAST_WAY)
        )
        aside = footholds.gait.lateral[1] - footholds.gait.lateral[0]
        self.least_aside, self.least_aside_way = _LEAST_ASIDE * aside, _LEAST_ASIDE_WAY * aside
        self._shortest_s, self._best_s, self._longest_s = self.swings.brisk_s

    def lag(self, view: HumanView, human_feet: Float, consumed: Float, second: float) -> tuple[float, float]:
        """How far the robot is behind at a source time, ahead and to the left in the human's heading [m of the robot].

        Args:
            human_feet: positions of the human's feet that the robot's feet represent, (2, 2) [m]; NaN: no lag.
            consumed: source time up to which the human swings of each foot are used up, (2,) [s].
        """
        left, right = self._lags(view, human_feet, consumed, second)
        return 0.5 * (left[0] + right[0]), 0.5 * (left[1] + right[1])

    def rear_foot(self, view: HumanView, human_feet: Float, consumed: Float, second: float) -> int:
        """The foot that is further behind the human's, 0 left, 1 right; arguments of `lag`."""
        left, right = self._lags(view, human_feet, consumed, second)
        return int(abs(right[0]) > abs(left[0]))

    def outer_foot(self, feet: Float, aside: float) -> int:
        """The foot that gets the robot further aside, 0 left, 1 right: the one in front, unless it is far out already.

        Args:
            feet: poses of both feet, (2, 4) [m, m, m, rad].
            aside: way to the left that is to be made [m].
        """
        front, yaw = 0 if aside > 0.0 else 1, float(feet[:, 3].mean())
        x, y = (feet[0] - feet[1])[:2].tolist()
        apart = cos(yaw) * y - sin(yaw) * x
        return front if apart < 0.5 * sum(self.footholds.gait.lateral) else 1 - front

    def _lags(self, view: HumanView, human_feet: Float, consumed: Float, second: float) -> list[tuple[float, float]]:
        """How far each foot is behind the human's; arguments of `lag`."""
        window = view.window
        yaw = window.mean_heading(*self._heading_s(second))
        places = (self._human_place(view, side, float(consumed[side]), second) for side in (0, 1))
        ways = ((place - foot).tolist() for place, foot in zip(places, human_feet, strict=True))
        known = [(0.0 if isnan(x) else x, 0.0 if isnan(y) else y) for x, y in ways]
        return [(self._along(view, way, yaw), self._along(view, way, yaw + 0.5 * pi)) for way in known]

    def _human_place(self, view: HumanView, side: int, consumed_s: float, second: float) -> Float:
        """Where the human's foot is at a source time, (2,) [m]: of one in the air, where it lifted.

        If the robot's foot has made its step for that swing already, it is where the human's foot lands.
        """
        window = view.window
        under_way = [s for s in window.swings if s.side == side and s.lift_s <= second < s.land_s]
        if under_way and under_way[-1].land_s <= consumed_s:
            return window.place(side, under_way[-1].land_s)
        return window.left(side, second)

    def falls_short(self, view: HumanView, swing: Swing, represented: Float) -> bool:
        """Whether a step for a human swing ends too far from the human's foothold to keep to the human's time.

        Args:
            represented: position on the human's ground that the foot represents after the step, (2,) [m].
        """
        return self._short(view, swing.side, swing.land_s, represented) > self.least_lag

    def step(
        self, view: HumanView, side: int, lift: int, feet: Float, human_feet: Float, *, least_way: float | None = None
    ) -> OwnStep | None:
        """A step of foot `side` that lifts at a tick; None where it would hardly take the foot any further.

        Args:
            feet: poses of both feet before the step, (2, 4) [m, m, m, rad].
            human_feet: positions of the human's feet that these represent, (2, 2) [m].
            least_way: of the foot [m]; that of a step between the human's where not given.
        """
        window, steady = view.window, self._best_s
        land_s = view.second_at(lift + self._ticks(steady))
        wanted = self.footholds.target(
            window,
            view.scaling,
            side,
            land_s,
            self._heading_s(land_s),
            feet[1 - side],
            human_feet[1 - side],
            steady,
        )
        if hypot(*(wanted.pose - feet[side])[:2].tolist()) < (self.least_way if least_way is None else least_way):
            return None
        shortest = self.swings.shortest_s(side, feet[side], wanted.pose)
        seconds = max(shortest, self.swings.stride_s(ahead_of(feet[1 - side], wanted.pose)))
        seconds = max(min(seconds, steady), self.swings.least_s)
        if self._short(view, side, land_s, wanted.human) > self.least_lag:
            land = self._with_human(view, side, lift, lift + self._ticks(steady))
        else:
            land = lift + self._ticks(seconds)
        land_s = view.second_at(land)
        # Swings that the human has begun until then are used up: the foothold is where they land.
        own = [swing.land_s for swing in window.swings if swing.side == side and swing.lift_s <= land_s]
        return OwnStep(side, lift, land, land_s, self._heading_s(land_s), max([land_s, *own]))

    def _heading_s(self, land_s: float) -> tuple[float, float]:
        return land_s - _HEADING_S[0], land_s + _HEADING_S[1]

    def _with_human(self, view: HumanView, side: int, lift: int, land: int) -> int:
        """The tick nearest to `land` at which the human's foot lands, if that leaves time for a fast step, or it."""
        earliest, latest = (lift + self._ticks(seconds) for seconds in (self._shortest_s, self._longest_s))
        landings = [
            self.timing.landing(view, swing, lift)
            for swing in view.window.swings
            if swing.side == side and swing.landed
        ]
        fits = [tick for tick in landings if earliest <= tick <= latest]
        return min(fits, key=lambda tick: abs(tick - land), default=land)

    def _short(self, view: HumanView, side: int, land_s: float, represented: Float) -> float:
        """How far a foot is from the human's in the human's heading [m of the robot]."""
        x, y = (view.window.place(side, land_s) - represented).tolist()
        return abs(self._along(view, (x, y), view.window.mean_heading(*self._heading_s(land_s))))

    def _along(self, view: HumanView, way: tuple[float, float], yaw: float) -> float:
        """Part of a way on the human's ground along a heading [m of the robot]."""
        scale = self.footholds.gait.stride_factor * view.scaling.ratio
        return scale * (cos(yaw) * way[0] + sin(yaw) * way[1])

    def _ticks(self, seconds: float) -> int:
        return ceil(seconds * self.timing.rate)
