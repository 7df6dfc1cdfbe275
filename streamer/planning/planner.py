"""`Planner`: gets the next second of human motion from the source and retargets it to the plan that plays next."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from flexmotion.configs.errors import RetargetError
from flexmotion.configs.stream import StreamSettings
from flexmotion.retarget.part_paths import NO_PARTS, PartGoals
from flexmotion.retarget.plan import Plan
from flexmotion.retarget.restrictions import NO_RESTRICTIONS, Restrictions
from flexmotion.retarget.retargeter import Retargeter
from flexmotion.retarget.view import begin_human, follow_drift
from flexmotion.sampling.blend import take_over
from flexmotion.streamer.motion.mirror_source import MirrorSource
from flexmotion.streamer.motion.sources import Source

_SPARE_S = 0.1
"""Human motion that is sampled beyond what a plan needs, for a plan that joins later than foreseen [s]."""


@dataclass(frozen=True)
class Planned:
    """A plan and the time that it took.

    Attributes:
        plan: joins at `plan.start_tick`.
        sample_s, retarget_s: time to get the human motion, and to retarget it [s].
        stops: it comes to a stop, whatever the source has.
        source_over: the source has nothing after this plan.
    """

    plan: Plan
    sample_s: float
    retarget_s: float
    stops: bool
    source_over: bool


class Planner:
    """Makes plans that each resume the state of the one before and blend in from its human; has no state of its own."""

    def __init__(self, retargeter: Retargeter, source: Source, settings: StreamSettings) -> None:
        self.retargeter, self.source, self.settings = retargeter, source, settings
        self.rate = retargeter.rate
        mirrors = isinstance(source, MirrorSource)
        self._blend_frames = settings.mirror_blend_frames if mirrors else settings.blend_frames

    def plan(
        self,
        join: int,
        current: Plan | None,
        *,
        stop: bool = False,
        partial: bool = False,
        exact: bool = False,
        parts: PartGoals = NO_PARTS,
        restrictions: Restrictions = NO_RESTRICTIONS,
        drift: float = np.nan,
        sway: NDArray[np.float64] | None = None,
        checkpoint: Callable[[], None] = lambda: None,
        settle: Callable[[], tuple[int, Plan | None]] | None = None,
    ) -> Planned:
        """The plan that plays from tick `join` on.

        Args:
            current: the plan that plays until then; None when the robot stands at its stand pose.
            stop: come to a balanced stop from there, whatever the source has.
            partial: follow the source only for the settings' `first_s`, which takes less time.
            exact: the feet turn to where the human looks by small steps too.
            parts, restrictions: see `Retargeter.plan`.
            drift: how far the robot has turned beyond its plans, up to a constant [rad]; NaN: not known.
            sway: divergent component of the robot minus that of its plan, which moves the next foothold, (2,) [m];
                None: none that is to be answered.
            checkpoint: called every few milliseconds; raises to abandon the plan.
            settle: called once the human motion is sampled, which takes the most uncertain time; returns the tick at
                which the plan joins in fact, not before `join`, and the plan that plays until then. None: as given.

        Raises:
            RetargetError: the plan has values that are not finite.
            FlexMotionError, LookupError: the source or the retargeter failed.
        """
        begin = time.perf_counter()
        retargeter = self.retargeter
        state = self._state(join, current)
        first = retargeter.next_frame(state, join, self.source.fps)
        horizon_s = self.settings.first_s if partial else self.settings.horizon_s
        horizon = int(round(horizon_s * self.rate))
        frames = int(np.ceil(horizon_s * self.source.fps)) + 2
        spare = 0 if settle is None else int(np.ceil(_SPARE_S * self.source.fps))
        motion = None if stop else self.source.window(first, frames + spare)
        sampled = time.perf_counter()
        checkpoint()
        if settle is not None:
            join, current = settle()
            state = self._state(join, current)
            later = retargeter.next_frame(state, join, self.source.fps) - first
            if motion is not None:
                motion = motion[later : later + frames] if later <= spare else self.source.window(first + later, frames)
            first += later
        ended = motion is None or len(motion) < frames
        if motion is not None and current is not None and current.human is not None:
            motion = take_over(current.human, current.human_first_frame, motion, first, self._blend_frames)
        state = state.copy()
        follow_drift(retargeter.layout.view(state), drift)
        if sway is not None:
            retargeter.answer(retargeter.layout.view(state), join, sway)
        plan = retargeter.plan(
            state,
            motion,
            first,
            join,
            horizon=horizon,
            exact=exact,
            parts=parts,
            restrictions=restrictions,
            checkpoint=checkpoint,
        )
        if not all(np.isfinite(part).all() for part in (plan.q, plan.qd, plan.torque, plan.stiffness, plan.base)):
            raise RetargetError(f"{self.source.name}: the plan for tick {join} holds values that are no numbers")
        # A short window is the source's end only if the plan has followed all of it.
        over = ended and plan.stop_row < horizon and not stop
        stops = stop or (plan.eased is not None and plan.eased.refused)
        return Planned(plan, sampled - begin, time.perf_counter() - sampled, stops, over)

    def first_frame(self, join: int, current: Plan | None) -> int:
        """Index of the first source frame that a plan from tick `join` on follows."""
        return self.retargeter.next_frame(self._state(join, current), join, self.source.fps)

    def zero_tick(self, join: int, current: Plan | None) -> float:
        """Loop tick at which the source's frame 0 is played by a plan from tick `join` on."""
        began = float(self.retargeter.layout.view(self._state(join, current)).source_tick)
        return began if np.isfinite(began) else join + round(self.settings.lead_in_s * self.rate)

    def human_yaw(self, join: int, current: Plan | None) -> float | None:
        """Heading of a human that looks where the robot's feet point after a stop [rad]; None before the first plan.

        Until the last foot has come beside the other, their mean is between two headings.
        """
        state = self.retargeter.layout.view(self._state(join, current))
        heading = float(self.stands_at(join, current)[2]) - float(state.heading)
        return heading if np.isfinite(heading) else None

    def without_human(self, plan: Plan) -> Plan:
        """A plan from whose states another human can be followed, who begins with frame 0 of the source."""
        states = plan.states.copy()
        begin_human(self.retargeter.layout.view(states))
        return replace(plan, states=states, human=None)

    def stands_at(self, join: int, current: Plan | None) -> NDArray[np.float64]:
        """Where the robot comes to stand if it stops from a join on; see `Retargeter.stands_at`."""
        return self.retargeter.stands_at(self._state(join, current), join)

    def _state(self, join: int, current: Plan | None) -> NDArray[np.float64]:
        if current is None:
            return self.retargeter.standing()
        return current.states[min(max(join - current.start_tick, 0), len(current) - 1)]
