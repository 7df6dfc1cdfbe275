"""`Walk`: the steps of a plan, the paths of the feet, and the balance over them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from flexmotion.retarget import balance, posture
from flexmotion.retarget.foot_goal import FootGoal
from flexmotion.retarget.footsteps import FeetState, FootstepPlanner
from flexmotion.retarget.joining import Absorbed, JoinAbsorber
from flexmotion.retarget.schedule import SHIFT_S, Schedule
from flexmotion.retarget.state import RetargetState
from flexmotion.retarget.steps import Step
from flexmotion.retarget.swing_check import Sway, SwingCheck
from flexmotion.retarget.view import HumanView
from flexmotion.retarget.whole_body import WholeBody
from flexmotion.retarget.zmp_roll import rolled

Float = NDArray[np.float64]

_STOP_S = 0.8
"""Length of the stop tail after the last touch-down: five time constants of a small robot's pendulum."""
_AT_REST_S = 0.4
"""This long after a touch-down the weight is at rest between the feet."""
_PUT_OFF_S = (0.1, 0.2)
"""How much longer notice new steps may be given where the weight cannot be moved in time; each try costs a twentieth of
a plan."""
_FADE_IN = 3.6
"""Time in which the weight becomes the human's once one is followed, in time constants of the robot's pendulum. A robot
that stands has its weight between its feet, and cannot have it elsewhere at once: first steps were put off for it by up
to 0.5 s."""
_TRIES = 2
"""How often steps are given more time in one plan."""


@dataclass(frozen=True)
class Walk:
    """Steps and what follows from them.

    Attributes:
        steps: in order of time.
        ticks: loop tick of each row of the plan, (T,).
        schedule: feet, contacts and load over the rows.
        balance: zero-moment point and divergent component over the rows.
        sway: what follows from these for the torso.
        withheld: steps of the human that are not made because a foot is to stay where it is.
    """

    steps: list[Step]
    ticks: Float
    schedule: Schedule
    balance: Absorbed
    sway: Sway
    withheld: int = 0


class WalkPlanner:
    """Plans steps and balance of one robot.

    Args:
        footsteps: chooses the steps.
        absorber: lets the divergent component start where the last plan left it.
        check: gives swings the time that they need.
        body: says how far its legs reach.
        sole_half_length: from a sole's centre to its toe edge [m].
        lead_in_s: time from the first plan for a human to source time 0 [s].
        rate_hz: loop ticks a second.
    """

    def __init__(
        self,
        footsteps: FootstepPlanner,
        absorber: JoinAbsorber,
        check: SwingCheck,
        body: WholeBody,
        sole_half_length: float,
        lead_in_s: float,
        rate_hz: float,
    ) -> None:
        self.footsteps, self.absorber, self.check, self.body = footsteps, absorber, check, body
        self.rate = rate_hz
        self._lead_in_s = lead_in_s
        self._sole_half_length = sole_half_length
        self._put_off = [int(round(seconds * rate_hz)) for seconds in _PUT_OFF_S]

    def follow(self, state: RetargetState, view: HumanView) -> Walk:
        """The human's walk; steps that would move the weight or a leg too fast are put off, or take longer.

        Args:
            state: where the plan resumes.
        """
        start = self._feet_state(state, view.tick)
        make = partial(self._in_time, state, view, start)
        walk = self._with_time(state, len(start.settled), make, last=not view.whole)
        return replace(walk, withheld=self.footsteps.withheld(view, start))

    def _with_time(
        self, state: RetargetState, settled: int, make: Callable[[Mapping[int, int]], Walk], *, last: bool
    ) -> Walk:
        """The walk whose swings have the time that they need.

        Args:
            settled: number of its steps that are settled.
            make: lays it out with some steps lengthened by ticks.
            last: no plan may follow.
        """
        longer: dict[int, int] = {}
        for _ in range(_TRIES):
            walk = make(longer)
            if not self.check.lengthen(longer, walk.steps, settled, state, walk.sway, last=last):
                return walk
        return make(longer)

    def _in_time(self, state: RetargetState, view: HumanView, start: FeetState, longer: Mapping[int, int]) -> Walk:
        """The human's walk; steps that would move the weight too fast for the soles are put off."""
        best = self._try(state, view, start, 0, longer)
        for put_off in self._put_off:
            if best.balance.excess <= 1.0:
                break
            later = self._try(state, view, start, put_off, longer)
            if later.balance.excess < best.balance.excess:
                best = later
        return best

    def stop(self, state: RetargetState, tick: int) -> Walk:
        """The settled steps, and one that puts the feet side by side.

        Args:
            state: where the plan resumes, at `tick`.
        """
        start = self._feet_state(state, tick)

        def make(longer: Mapping[int, int]) -> Walk:
            settled = [step.longer(longer.get(k, 0)) for k, step in enumerate(start.settled)]
            return self._lay_out(state, self.footsteps.end(start, settled, tick, longer), tick, None)

        return self._with_time(state, len(start.settled), make, last=True)

    def stands_at(self, state: RetargetState, tick: int) -> Float:
        """Middle of the feet and their heading at the end of a stop, (3,) [m, m, rad]; arguments as of `stop`."""
        start = self._feet_state(state, tick)
        feet = start.feet
        for step in self.footsteps.end(start, start.settled, tick):
            feet[step.side] = step.target
        return between(feet)

    def _try(
        self, state: RetargetState, view: HumanView, start: FeetState, put_off: int, longer: Mapping[int, int]
    ) -> Walk:
        """The walk with its new steps put off by some ticks, and some of them lengthened."""
        steps = self.footsteps.plan(view, start, put_off, longer)
        # Where the frames end before the horizon this plan is the last one: it is played to its end.
        if not view.whole:
            steps = self.footsteps.end(start, steps, view.end_tick, longer)
        return self._lay_out(state, steps, view.tick, view)

    def _feet_state(self, state: RetargetState, tick: int) -> FeetState:
        landed = float(state.landed)
        feet = state.feet.copy()
        feet[:, 2] = 0.0
        placed, upright = float(state.placed[0]), float(state.upright)
        planted = frozenset((0, 1)) if np.isposinf(upright) else frozenset(map(int, np.flatnonzero(state.planted)))
        return FeetState(
            feet=feet,
            human_feet=state.human_feet,
            consumed=state.consumed,
            free=self.footsteps.timing.free(1 - int(state.stance), landed),
            settled=state.steps.steps(),
            at_rest=tick > landed + _AT_REST_S * self.rate,
            planted=planted,
            placed=None if placed < 0 else FootGoal(int(placed), *map(float, state.placed[1:])),
            astride=bool(state.astride),
            upright=int(np.ceil(upright)) if np.isfinite(upright) else 0,
        )

    def _lay_out(self, state: RetargetState, steps: list[Step], tick: int, view: HumanView | None) -> Walk:
        """Feet and balance over the rows of a plan that starts at `tick`."""
        follow = 0 if view is None else view.follow
        last = max([tick + follow, *[step.land for step in steps]])
        ticks = tick + np.arange(last - tick + int(round(_STOP_S * self.rate)), dtype=float)
        quiet = np.full(len(ticks), 0.5)
        # A head that is to be at a place sways with no human.
        if view is not None and tick >= float(state.upright):
            seconds = view.seconds(ticks[:follow])
            begun = np.clip((seconds + self._lead_in_s) * self.absorber.omega / _FADE_IN, 0.0, 1.0)
            quiet = posture.quiet_share(view.window, seconds, begun, len(ticks), SHIFT_S * self.rate)
        schedule = Schedule.of(
            state.feet,
            float(state.landed),
            float(state.stance),
            steps,
            ticks,
            quiet,
            self.rate,
            self.footsteps.swings,
        )
        # Hips that are low for a step stay low to the end: a plan ends at rest, not while the hips rise.
        tail = schedule.walking[follow:]
        np.logical_or.accumulate(tail, out=tail)
        balanced = self._balance(state, schedule)
        com, velocity = balance.centre_of_mass(balanced.dcm, state.com, self.absorber.omega, self.absorber.dt)
        reach = self.body.reachable_height(schedule.feet, com, state.com_offset)
        return Walk(steps, ticks, schedule, balanced, Sway(ticks, schedule, com, velocity, reach))

    def _balance(self, state: RetargetState, schedule: Schedule) -> Absorbed:
        share = schedule.share[:, None]
        left, right = schedule.feet[:, 0], schedule.feet[:, 1]
        roll = rolled(left, right, self._sole_half_length)
        zmp = (1.0 - share) * (left[:, :2] + roll) + share * (right[:, :2] - roll)
        dcm = balance.divergent_component(zmp, self.absorber.omega, self.absorber.dt)
        return self.absorber.absorb(zmp, dcm, state.dcm, float(schedule.feet[0, :, 3].mean()))


def between(feet: Float) -> Float:
    """Middle of two feet (2, 4) and their heading, (3,) [m, m, rad]."""
    middle: Float = 0.5 * (feet[0] + feet[1])[[0, 1, 3]]
    return middle
