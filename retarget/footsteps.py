"""Which steps the robot makes, when, and where to: those of the human, at the human's time, as far as its legs allow.

A step lifts when the human's foot lifts, or as soon as the robot's other foot has landed and carries the weight. It
lands with the human's foot, or when the robot's foot can be there. A robot that lags behind its human steps in its own
cadence until it has caught up (`cadence.py`). Where a human turns or slides on planted feet, the robot cannot: steps
are inserted, one foot after the other, until its feet agree with the human's again.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from flexmotion.configs.robot import Robot
from flexmotion.configs.robot_file import Gait
from flexmotion.configs.stream import StreamSettings
from flexmotion.retarget.cadence import Cadence, OwnStep
from flexmotion.retarget.foot_goal import FootGoal
from flexmotion.retarget.footholds import Footholds
from flexmotion.retarget.human import Swing
from flexmotion.retarget.human_steps import is_consumed, is_step
from flexmotion.retarget.step_timing import INSERTED_SWING_S, StepTiming
from flexmotion.retarget.steps import NOTICE_S, UNHURRIED_S, Step
from flexmotion.retarget.swing import Swings
from flexmotion.retarget.view import HumanView

Float = NDArray[np.float64]

INSERT_YAW, INSERT_DISTANCE = 0.26, 0.045
"""Feet further than this from their footholds are corrected by an inserted step [rad, m of the robot]."""
EXACT_YAW = 0.06
"""Likewise, of a human that looks where the robot's feet are to point: what a plan for it corrects [rad]."""
_NO_LONGER: Mapping[int, int] = MappingProxyType({})
_MOST_OWN = 8
"""Steps of the robot's own cadence in a row in one plan, at most."""
_BESIDE_DISTANCE, _BESIDE_YAW = 0.015, 0.09
"""Feet nearer than this to standing side by side are left as they are at the end of a plan [m, rad]."""


@dataclass(frozen=True, eq=False)
class FeetState:
    """The robot's feet where a plan starts.

    Attributes:
        feet: poses of both feet on the ground (of a foot in the air: its last), (2, 4) [m, m, m, rad].
        human_feet: positions of the human's feet that these represent, (2, 2) [m]; NaN where there are none.
        consumed: source time up to which the human swings of each foot are used up, (2,) [s].
        free: ticks from which each foot may lift, (2,).
        settled: steps that are under way or settled, in order; they are kept.
        at_rest: whether the robot has been standing still.
        planted: feet that are to stay where they are, 0 left, 1 right; while there is one no human's step is made.
        placed: where a foot is to be; while there is such a place its step is the only one that is made.
        astride: the feet stay as they have landed, though no human is followed.
        upright: tick before which no foot lifts: hips and trunk are on their way back from a place of their own.
    """

    feet: Float
    human_feet: Float
    consumed: Float
    free: Float
    settled: list[Step]
    at_rest: bool
    planted: frozenset[int] = frozenset()
    placed: FootGoal | None = None
    astride: bool = False
    upright: int = 0


def short_sight(robot: Robot, settings: StreamSettings) -> str | None:
    """Why plans do not reach far enough ahead for a step to be inserted; None: they do."""
    pause_s, step_s = robot.gait.double_support_min_s, UNHURRIED_S + INSERTED_SWING_S
    if pause_s + step_s <= settings.horizon_s:
        return None
    most, longer = settings.horizon_s - step_s, f"horizon_s of {pause_s + step_s:.3g} or more in the stream settings"
    expected = longer if most < 1.0 / robot.rate_hz else f"at most {most:.3g}, or {longer}"
    return (
        f"{robot.file}: field gait.double_support_min_s: {pause_s:g} s, expected {expected}: no step fits into plans "
        f"of {settings.horizon_s:g} s"
    )


class FootstepPlanner:
    """Chooses steps over a window of human motion.

    Args:
        gait: the robot's gait limits.
        swings: paths of its feet, and how far they get in which time.
        stand_width: distance between the robot's sole centres at its stand pose [m].
        sole_half_length: from a sole's centre to its toe edge [m].
        rate_hz: loop ticks a second.
    """

    def __init__(self, gait: Gait, swings: Swings, stand_width: float, sole_half_length: float, rate_hz: float) -> None:
        self.swings, self.footholds = swings, Footholds(gait, swings, stand_width, sole_half_length)
        self.timing = StepTiming(gait, swings, rate_hz)
        self.cadence = Cadence(self.footholds, self.timing)
        self.sight_s = UNHURRIED_S + INSERTED_SWING_S + gait.double_support_min_s
        """How far ahead the human must be known for a step to be inserted [s]."""

    def plan(
        self, view: HumanView, start: FeetState, put_off: int = 0, longer: Mapping[int, int] = _NO_LONGER
    ) -> list[Step]:
        """The steps from the start of a plan to the end of the human's frames.

        Args:
            put_off: ticks by which steps that are not settled yet keep more than the shortest notice.
            longer: ticks by which steps land later, by their place in the result; of those that are not settled.

        Returns:
            Steps in order of time, the settled ones first.
        """
        if start.placed is not None:
            settled = [step.longer(longer.get(place, 0)) for place, step in enumerate(start.settled)]
            begun, until = replace(start, settled=settled), view.tick_at(view.window.end_s)
            return self._to_place(begun, start.placed, view.tick + put_off, until, longer)
        if start.planted:
            return start.settled
        timing, window = self.timing, view.window
        notice_s = UNHURRIED_S if start.at_rest and not start.settled else NOTICE_S
        earliest, insertable = (view.tick + timing.ticks(s) + put_off for s in (notice_s, UNHURRIED_S))
        made = _Sequence(start, timing, earliest, longer)
        end = view.tick_at(window.end_s)
        dropped = 0
        for swing in window.swings:
            side = swing.side
            if is_consumed(swing, float(made.consumed[side])) or not is_step(window, swing):
                continue
            if made.lift(view, swing) >= end:
                break
            self._catch_up(view, made, insertable, swing)
            if is_consumed(swing, float(made.consumed[side])):
                continue
            lift = made.lift(view, swing)
            if timing.is_too_late(view, swing, lift):
                dropped += 1
                made.consumed[side] = swing.land_s
                continue
            self._insert(view, made, insertable, timing.landed_by(side, lift))
            lift = max(lift, int(made.free[side]))
            land = timing.landing(view, swing, lift)
            # A swing whose landing is not in the window is used up when the robot's foot has landed.
            consumed_s = swing.land_s if swing.landed else max(swing.land_s, view.second_at(land))
            human_s = swing.land_s, (swing.lift_s, swing.land_s)
            step = self._step(view, made, side, (lift, land), human_s, consumed_s, dropped)
            if self.cadence.falls_short(view, swing, step.human):
                own = self.cadence.step(view, side, lift, made.feet, made.human_feet, least_way=0.0)
                step = replace(self._own(view, made, own), dropped=dropped) if own is not None else step
            made.add(step)
            dropped = 0
        # What the human leaves undone when its frames end, the robot does before it stops.
        self._catch_up(view, made, insertable)
        self._insert(view, made, insertable, np.full(2, float(end - timing.pause)))
        if made.steps and not start.settled:
            made.steps[0] = replace(made.steps[0], notice_s=max(notice_s, made.steps[0].notice_s))
        return made.steps

    def withheld(self, view: HumanView, start: FeetState) -> int:
        """How many of the human's steps are not made because a foot is to stay where it is, or to be somewhere."""
        if not start.planted and start.placed is None:
            return 0
        window, end, gone = view.window, view.tick_at(view.window.end_s), start.consumed
        open_swings = (swing for swing in window.swings if not is_consumed(swing, float(gone[swing.side])))
        begun = (swing for swing in open_swings if view.tick <= view.tick_at(swing.lift_s) < end)
        return sum(is_step(window, swing) for swing in begun)

    def end(
        self, start: FeetState, steps: list[Step], after: int, longer: Mapping[int, int] = _NO_LONGER
    ) -> list[Step]:
        """The steps of a plan that no human follows, or only to its frames' end, and those that it ends with.

        A foot that is to be somewhere is brought there if its step is due soon; else the feet come side by side.

        Args:
            start: the feet before the steps.
            after: first tick from which the robot has nothing else to do.
            longer: ticks by which the step after them lands later, by its place.
        """
        if start.astride:
            return steps
        if start.placed is not None:
            begun = replace(start, settled=steps)
            return self._to_place(begun, start.placed, after, after + self.timing.ticks(self.sight_s), longer)
        return self._gather(start, steps, max(after, start.upright), longer)

    def _gather(self, start: FeetState, steps: list[Step], after: int, longer: Mapping[int, int]) -> list[Step]:
        """The steps, and one more that puts the feet side by side if they would not end so.

        A robot that walked moves the foot that did not land last, so that it ends where the foot in front is. A robot
        that rests moves the foot that landed last back. Planted feet stay. Arguments as of `end`.
        """
        if len(start.planted) == 2:
            return steps
        # The foot that has landed last may lift again later than the other one.
        feet, landed = start.feet.copy(), steps[-1].side if steps else int(np.argmax(start.free))
        side = landed if start.at_rest and not steps else 1 - landed
        if side in start.planted:
            side = 1 - side
        for step in steps:
            feet[step.side] = step.target
            after = max(after, step.land)
        foot, other = feet[side], feet[1 - side]
        across = self.footholds.stand_width * (1.0 if side == 0 else -1.0)
        beside = other + np.array([-np.sin(other[3]) * across, np.cos(other[3]) * across, 0.0, 0.0])
        if np.hypot(*(foot - beside)[:2]) < _BESIDE_DISTANCE and abs(foot[3] - other[3]) < _BESIDE_YAW:
            return steps
        lift = after + self.timing.ticks(UNHURRIED_S)
        # The last step must end beside the other foot: a long or turning one takes more time.
        seconds = max(INSERTED_SWING_S, self.swings.shortest_s(side, foot, beside))
        land = lift + int(np.ceil(seconds * self.timing.rate)) + longer.get(len(steps), 0)
        # It uses up no swing of the human.
        last = Step(side, lift, land, foot.copy(), beside, -np.inf, inserted=True, notice_s=UNHURRIED_S)
        return [*steps, last]

    def _to_place(
        self, start: FeetState, goal: FootGoal, tick: int, until: float, longer: Mapping[int, int]
    ) -> list[Step]:
        """The settled steps, and the one that brings a foot to where it is to be, if it lifts before a tick.

        It lands when it is due. What its swing needs more time for (`longer`) it lifts earlier, where it may.

        Args:
            tick: from which further steps are given notice; until: before which they lift.
        """
        timing = self.timing
        made = _Sequence(start, timing, tick + timing.ticks(UNHURRIED_S), _NO_LONGER)
        side, place = goal.side, len(made.steps)
        if side in start.planted or goal.is_there(made.feet):
            return made.steps
        foot, target = made.feet[side], goal.pose(made.feet[1 - side])
        seconds = max(INSERTED_SWING_S, self.swings.shortest_s(side, foot, target))
        ticks = int(np.ceil(seconds * timing.rate)) + longer.get(place, 0)
        lift = int(max(np.ceil(made.free[side]), np.rint(goal.due) - ticks))
        if lift < until:
            # It uses up no swing of the human.
            step = Step(side, lift, lift + ticks, foot.copy(), target, -np.inf, inserted=True, notice_s=UNHURRIED_S)
            made.add(step)
        return made.steps

    def _catch_up(self, view: HumanView, made: _Sequence, unhurried: int, swing: Swing | None = None) -> None:
        """Add steps of the robot's own cadence for as long as the robot lags behind its human.

        Args:
            unhurried: tick from which steps may lift where the weight is at rest between the feet.
            swing: human swing before whose step they lift, if none of them is made for it. None: they are the last of
                the plan, also after the human's frames where those have ended.
        """
        cadence = self.cadence
        before = float(view.tick_at(view.window.end_s)) if view.whole else np.inf
        enough = cadence.least_lag if view.whole or swing is not None else cadence.last_lag
        for _ in range(_MOST_OWN):
            if swing is not None:
                before = made.lift(view, swing)
                if is_consumed(swing, float(made.consumed[swing.side])):
                    return
            lift, notice_s = int(np.ceil(made.free.min())), NOTICE_S
            if lift > made.landed + self.timing.ticks(NOTICE_S):
                lift, notice_s = max(lift, unhurried), UNHURRIED_S
            second = view.second_at(lift)
            if lift >= before:
                return
            ahead, aside = cadence.lag(view, made.human_feet, made.consumed, second)
            sidles = abs(ahead) < enough
            if sidles and abs(aside) < cadence.least_aside:
                return
            rested = made.free <= lift
            if not rested.all():
                side = int(np.argmax(rested))
            elif sidles:
                side = cadence.outer_foot(made.feet, aside)
            else:
                side = cadence.rear_foot(view, made.human_feet, made.consumed, second)
            least_way = cadence.least_aside_way if sidles else cadence.least_way
            own = cadence.step(view, side, lift, made.feet, made.human_feet, least_way=least_way)
            if own is None:
                return
            made.add(replace(self._own(view, made, own), notice_s=notice_s))

    def _own(self, view: HumanView, made: _Sequence, own: OwnStep) -> Step:
        """A step of the robot's own cadence."""
        return self._step(view, made, own.side, (own.lift, own.land), (own.land_s, own.heading_s), own.consumed_s)

    def _insert(self, view: HumanView, made: _Sequence, earliest: int, landed_by: Float) -> None:
        """Add steps that correct the feet, if there is time for them.

        Args:
            earliest: tick from which steps may be inserted.
            landed_by: ticks by which each foot must have landed, (2,).
        """
        window = view.window
        ticks = self.timing.ticks(INSERTED_SWING_S)
        free = np.maximum(made.free, earliest)
        lift = int(np.ceil(free.min()))
        while lift + ticks <= landed_by.max():
            second = view.second_at(lift)
            frame = int(window.frame_before(np.array([second]))[0])
            if not window.contacts[frame].all():
                lift += max(1, int(view.rate_hz / window.motion.fps))
                continue
            errors = self._errors(view, made, second)
            wrong = (errors > 1.0) & (lift + ticks <= landed_by)
            if not wrong.any():
                lift += ticks // 2
                continue
            if not (wrong & (free <= lift)).any():
                lift = int(np.ceil(free[wrong].min()))
                continue
            side = int(np.argmax(np.where(wrong & (free <= lift), errors, 0.0)))
            land = lift + ticks
            # The human of another clip may stand in the opposite stride: the next step, of either foot, does the rest.
            step = self._step(view, made, side, (lift, land), (second, (second, second)), float(made.consumed[side]))
            made.add(replace(step, inserted=True, notice_s=UNHURRIED_S))
            free = np.maximum(made.free, earliest)
            lift = made.steps[-1].land + self.timing.pause

    def _errors(self, view: HumanView, made: _Sequence, second: float) -> Float:
        """Distance of both feet from their footholds at a source time, over the distance that is corrected, (2,)."""
        targets = [
            self.footholds.target(
                view.window,
                view.scaling,
                side,
                second,
                (second, second),
                made.feet[1 - side],
                made.human_feet[1 - side],
                INSERTED_SWING_S,
            ).pose
            for side in (0, 1)
        ]
        gaps = np.array(targets) - made.feet
        apart = np.linalg.norm(gaps[:, :2], axis=1)
        turned = EXACT_YAW if view.exact else INSERT_YAW
        return np.maximum(np.abs(gaps[:, 3]) / turned, apart / INSERT_DISTANCE)

    def _step(
        self,
        view: HumanView,
        made: _Sequence,
        side: int,
        ticks: tuple[int, int],
        human_s: tuple[float, tuple[float, float]],
        consumed_s: float,
        dropped: int = 0,
    ) -> Step:
        """A step of foot `side` between two loop ticks.

        Args:
            human_s: source times of the foothold, `land_s` and `heading_s` of `Footholds.target`.
        """
        lift, land = ticks
        seconds = (land - lift) / view.rate_hz
        hold = self.footholds.of_swing(view.window, view.scaling, side, *human_s, made.feet, made.human_feet, seconds)
        return Step(side, lift, land, made.feet[side].copy(), hold.pose, consumed_s, dropped, human=hold.human)


class _Sequence:
    """Steps chosen so far, and the feet after them; attributes as in `FeetState`.

    Args:
        start: where the steps start; its settled steps are the first.
        earliest: tick from which further steps may lift.
        longer: ticks by which further steps land later, by their place.
    """

    def __init__(self, start: FeetState, timing: StepTiming, earliest: int, longer: Mapping[int, int]) -> None:
        self.timing, self.longer = timing, longer
        self.steps: list[Step] = []
        self.feet, self.human_feet, self.consumed = start.feet.copy(), start.human_feet.copy(), start.consumed.copy()
        self.free = np.maximum(start.free, max(earliest, start.upright))
        self.landed = float(start.free.min()) - timing.pause
        for step in start.settled:
            self.add(step)

    def lift(self, view: HumanView, swing: Swing) -> int:
        """Tick at which the step for a human swing lifts, at the earliest."""
        return max(view.tick_at(swing.lift_s), int(self.free[swing.side]))

    def add(self, step: Step) -> None:
        """Append a step."""
        step = step.longer(self.longer.get(len(self.steps), 0))
        self.steps.append(step)
        self.feet[step.side], self.human_feet[step.side] = step.target, step.human
        self.consumed[step.side] = max(self.consumed[step.side], step.consumed_s)
        self.landed = float(step.land)
        self.free = np.maximum(self.free, self.timing.free(step.side, step.land))
