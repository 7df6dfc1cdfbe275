"""`Walk`: the steps of a plan, the paths of the feet, and the balance over them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexmotion.retarget import balance, posture
from flexmotion.retarget.footsteps import FeetState, FootstepPlanner
from flexmotion.retarget.joining import Absorbed, JoinAbsorber
from flexmotion.retarget.schedule import SHIFT_S, Schedule
from flexmotion.retarget.state import RetargetState
from flexmotion.retarget.steps import Step
from flexmotion.retarget.view import HumanView

Float = NDArray[np.float64]

_STOP_S = 0.8
"""Length of the stop tail after the last touch-down: five time constants of a small robot's pendulum."""
_AT_REST_S = 0.4
"""This long after a touch-down the weight is at rest between the feet."""
_PUT_OFF_S = (0.1, 0.2)
"""How much longer notice new steps may be given where the weight cannot be moved in time; each try costs a twentieth of
a plan."""


@dataclass(frozen=True)
class Walk:
    """Steps and what follows from them.

    Attributes:
        steps: in order of time.
        ticks: loop tick of each row of the plan, (T,).
        schedule: feet, contacts and load over the rows.
        balance: zero-moment point and divergent component over the rows.
    """

    steps: list[Step]
    ticks: Float
    schedule: Schedule
    balance: Absorbed


class WalkPlanner:
    """Plans steps and balance of one robot.

    Args:
        footsteps: chooses the steps.
        absorber: lets the divergent component start where the last plan left it.
        rate_hz: loop ticks a second.
    """

    def __init__(self, footsteps: FootstepPlanner, absorber: JoinAbsorber, rate_hz: float) -> None:
        self.footsteps, self.absorber, self.rate = footsteps, absorber, rate_hz
        self._put_off = [int(round(seconds * rate_hz)) for seconds in _PUT_OFF_S]

    def follow(self, state: RetargetState, view: HumanView) -> Walk:
        """The human's walk; steps that would move the weight too fast for the soles are put off.

        Args:
            state: where the plan resumes.
        """
        start = self._feet_state(state, view.tick)
        best = self._try(state, view, start, 0)
        for put_off in self._put_off:
            if best.balance.excess <= 1.0:
                break
            later = self._try(state, view, start, put_off)
            if later.balance.excess < best.balance.excess:
                best = later
        return best

    def stop(self, state: RetargetState, tick: int) -> Walk:
        """The settled steps, and one that puts the feet side by side.

        Args:
            state: where the plan resumes, at `tick`.
        """
        start = self._feet_state(state, tick)
        steps = self.footsteps.gather(start.settled, start.feet, tick)
        return self._lay_out(state, steps, tick, None)

    def stands_at(self, state: RetargetState, tick: int) -> Float:
        """Middle of the feet and their heading at the end of a stop, (3,) [m, m, rad]; arguments as of `stop`."""
        start = self._feet_state(state, tick)
        feet = start.feet
        for step in self.footsteps.gather(start.settled, feet, tick):
            feet[step.side] = step.target
        middle: Float = 0.5 * (feet[0] + feet[1])[[0, 1, 3]]
        return middle

    def _try(self, state: RetargetState, view: HumanView, start: FeetState, put_off: int) -> Walk:
        """The walk with its new steps put off by some ticks."""
        steps = self.footsteps.plan(view, start, put_off)
        # Where the frames end before the horizon this plan is the last one: it is played to its end.
        if not view.whole:
            steps = self.footsteps.gather(steps, start.feet, view.end_tick)
        return self._lay_out(state, steps, view.tick, view)

    def _feet_state(self, state: RetargetState, tick: int) -> FeetState:
        landed = float(state.landed)
        feet = state.feet.copy()
        feet[:, 2] = 0.0
        return FeetState(
            feet=feet,
            human_feet=state.human_feet,
            consumed=state.consumed,
            free=self.footsteps.timing.free(1 - int(state.stance), landed),
            settled=state.steps.steps(),
            at_rest=tick > landed + _AT_REST_S * self.rate,
        )

    def _lay_out(self, state: RetargetState, steps: list[Step], tick: int, view: HumanView | None) -> Walk:
        """Feet and balance over the rows of a plan that starts at `tick`."""
        follow = 0 if view is None else view.follow
        last = max([tick + follow, *[step.land for step in steps]])
        ticks = tick + np.arange(last - tick + int(round(_STOP_S * self.rate)), dtype=float)
        quiet = np.full(len(ticks), 0.5)
        if view is not None:
            quiet = posture.quiet_share(view.window, view.seconds(ticks[:follow]), len(ticks), SHIFT_S * self.rate)
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
        return Walk(steps, ticks, schedule, self._balance(state, schedule))

    def _balance(self, state: RetargetState, schedule: Schedule) -> Absorbed:
        share = schedule.share[:, None]
        zmp = (1.0 - share) * schedule.feet[:, 0, :2] + share * schedule.feet[:, 1, :2]
        dcm = balance.divergent_component(zmp, self.absorber.omega, self.absorber.dt)
        return self.absorber.absorb(zmp, dcm, state.dcm, float(schedule.feet[0, :, 3].mean()))
