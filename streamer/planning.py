"""`Planning`: looks at what the loop told last and makes the plan that is due; in its own process, or in lockstep."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from configs.stream import StreamSettings
from drivers.realtime.ring import Ring
from retarget.plan import Plan
from streamer.clip_library import LiveSource
from streamer.ladder import State
from streamer.plan_buffer import PlanBuffer, Ticket
from streamer.planner import Planner
from streamer.targets import NO_TARGET, Target, TargetMailbox

_KEPT = 4
"""Plans that may still be gone on from: playing, waiting, offered, and one more."""
EFFECT_RAD = np.radians(2.0)
"""A joint that is sent this much elsewhere shows a target's effect (the report's definition)."""


class Planning:
    """The planner's side of the live system.

    Args:
        ticks: the loop's rows.
        targets: where targets arrive; a source that takes none ignores it.
    """

    def __init__(
        self,
        planner: Planner,
        plans: PlanBuffer,
        ticks: Ring,
        settings: StreamSettings,
        targets: TargetMailbox | None = None,
    ) -> None:
        self.planner, self.plans, self.ticks, self.settings = planner, plans, ticks, settings
        self.targets = targets
        self._replan_ticks = round(settings.replan_s * planner.rate)
        self.commit_ticks = max(round(settings.commit_s * planner.rate), 1)
        self._made: dict[int, tuple[Ticket, Plan]] = {}
        self._asked_tick = 0
        self._target = NO_TARGET  # the newest; it may not have reached a plan that plays yet

    def step(self, tick: int, lead: int) -> bool:
        """Make and publish a plan if one is due.

        Args:
            tick: the tick that the loop does next.
            lead: ticks from there to the join.

        Returns:
            Whether one was made.

        Raises:
            FlexMotionError, ArithmeticError, ValueError, LookupError: source or retargeter failed.
        """
        status = self.ticks.latest()
        if self.targets is not None:
            self._target = self.targets.newest()
        if status is None or not self._due(status):
            return False
        self._asked_tick = tick
        resumed = int(status["plan"])
        current = self._made[resumed][1] if resumed else None
        join = tick + lead
        stop = bool(status["must_stop"])
        target = NO_TARGET if stop else self._target
        if target.id > int(status["target"]):
            self._turn_to(target, current, join)
        planned = self.planner.plan(join, current, stop=stop)
        ticket = Ticket(
            id=self.plans.newest_id + 1,
            resumed=resumed,
            asked_tick=tick,
            target=target.id,
            target_ns=target.stamp_ns,
            effect_row=-1 if current is None else _effect_row(current, planned.plan),
            stops=planned.stops,
            source_over=planned.source_over,
            sample_s=planned.sample_s,
            retarget_s=planned.retarget_s,
        )
        self._made[ticket.id] = ticket, planned.plan
        self._made = {key: self._made[key] for key in sorted(self._made)[-_KEPT:] if key >= resumed}
        self.plans.publish(ticket, planned.plan)
        return True

    def warm_up(self) -> None:
        """Plan once from the stand pose, for nothing but to touch all that planning needs."""
        self.planner.plan(0, None)

    def _due(self, status: NDArray[Any]) -> bool:
        """Whether a plan is to be made now."""
        newest, plan = self.plans.newest_id, int(status["plan"])
        if status["pending"] or newest > int(status["offer"]):
            return False  # the last one has not joined, or has not been looked at
        must_stop = bool(status["must_stop"])
        if not plan:
            return bool(status["ready"]) and not must_stop
        if status["state"] not in (State.STREAMING, State.HOLD):
            return False
        if plan not in self._made:
            return False
        ticket = self._made[plan][0]
        if must_stop:
            return not ticket.stops and not status["plan_over"]
        if self._target.id > int(status["target"]):
            return True
        if ticket.source_over:
            return False
        refused = newest != plan
        return refused or int(status["tick"]) + 1 >= self._asked_tick + self._replan_ticks

    def _turn_to(self, target: Target, current: Plan | None, join: int) -> None:
        """Let the source follow a new target from the join on."""
        source = self.planner.source
        if not isinstance(source, LiveSource):
            return
        frame = self.planner.first_frame(join, current)
        here = None
        if current is not None and current.human is not None:
            place = min(max(frame - current.human_first_frame, 0), len(current.human) - 1)
            here = current.human[place : place + 1]
        source.turn_to(target, frame, here)


def _effect_row(before: Plan, after: Plan) -> int:
    """First row of `after` at which a joint is sent elsewhere than `before` would have sent it; -1: none."""
    offset = after.start_tick - before.start_tick
    rows = np.minimum(np.arange(len(after)) + offset, len(before) - 1)
    differs = np.abs(after.q - before.q[rows]).max(axis=1) > EFFECT_RAD
    return int(np.argmax(differs)) if differs.any() else -1

