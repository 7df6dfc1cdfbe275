"""`Replanner`: looks at what the loop told last and makes the plan that is due; in its own process, or in lockstep."""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexmotion.configs.errors import ConfigError
from flexmotion.configs.stream import StreamSettings
from flexmotion.drivers.realtime.ring import Ring
from flexmotion.retarget.plan import Plan
from flexmotion.streamer.control.ladder import State
from flexmotion.streamer.control.plan_buffer import PlanBuffer, Ticket
from flexmotion.streamer.motion.sources import LiveSource
from flexmotion.streamer.motion.targets import NO_TARGET, Target, TargetMailbox
from flexmotion.streamer.planning.lead import Kind, Lead
from flexmotion.streamer.planning.planner import Planner

EFFECT_RAD = np.radians(2.0)
"""A joint that is sent this much elsewhere shows a target's effect (the report's definition)."""


class Superseded(Exception):  # noqa: N818 - no error: something newer is asked for
    """The plan that is being made is no longer wanted."""


class Replanner:
    """The planner's side of the live system.

    Args:
        ticks: the loop's rows.
        targets: where targets arrive; a source that takes none ignores them.
        lead: how far ahead plans join.
        tell: told of targets that cannot be followed.
    """

    def __init__(
        self,
        planner: Planner,
        plans: PlanBuffer,
        ticks: Ring,
        settings: StreamSettings,
        targets: TargetMailbox,
        lead: Lead,
        tell: Callable[[str], None] = lambda _message: None,
    ) -> None:
        self.planner, self.plans, self.ticks, self.settings = planner, plans, ticks, settings
        self.targets, self.lead, self.tell = targets, lead, tell
        self._refused = 0
        self._follows = isinstance(planner.source, LiveSource)
        self._replan_ticks = round(settings.replan_s * planner.rate)
        self._least_unplayed = round(settings.min_unplayed_s * planner.rate)
        self._commit_ticks = max(round(settings.commit_s * planner.rate), 1)
        self._made: dict[int, tuple[Ticket, Plan]] = {}
        self._asked_tick = 0

    def step(self, tick: int) -> bool:
        """Make and publish a plan if one is due.

        Args:
            tick: the tick that the loop does next.

        Returns:
            Whether one was made.

        Raises:
            FlexMotionError, ArithmeticError, ValueError, LookupError: source or retargeter failed.
        """
        status = self.ticks.latest()
        target = self._newest_target()
        if status is None or not self._due(status, target):
            return False
        begin = time.perf_counter()
        kind = self._kind(status, target)
        join = tick + self.lead.ticks(kind)
        resumed = self._playing_at(join, status)
        current = self._made[resumed][1] if resumed else None
        if current is not None:
            # The first moments of a plan are committed against its own redraw; a new target or a stop does not wait.
            join = max(join, current.start_tick + (self._commit_ticks if kind is Kind.WHOLE else 1))
        if kind is Kind.STOP:
            target = NO_TARGET
        elif self._is_new(target, status) and not self._turn_to(target, current, join):
            return False
        try:
            planned = self.planner.plan(
                join,
                current,
                stop=kind is Kind.STOP,
                partial=kind is Kind.PARTIAL,
                checkpoint=partial(self._check, kind, target),
            )
        except Superseded:
            return False
        self._asked_tick = tick
        ticket = Ticket(
            id=self.plans.newest_id + 1,
            resumed=resumed,
            asked_tick=tick,
            target=target.id,
            target_ns=target.stamp_ns,
            effect_row=-1 if current is None else _effect_row(current, planned.plan),
            partial=kind is Kind.PARTIAL,
            stops=planned.stops,
            source_over=planned.source_over,
            sample_s=planned.sample_s,
            retarget_s=planned.retarget_s,
        )
        self._made[ticket.id] = ticket, planned.plan
        # Whatever was refused since, the plan that plays can be gone on from.
        self._made = {key: made for key, made in self._made.items() if key >= int(status["plan"])}
        self.plans.publish(ticket, planned.plan)
        self.lead.took(kind, time.perf_counter() - begin)
        return True

    def warm_up(self) -> None:
        """Plan once from the stand pose, for nothing but to touch all that planning needs."""
        self.planner.plan(0, None)

    def _due(self, status: NDArray[Any], target: Target) -> bool:
        """Whether a plan is to be made now."""
        newest, plan = self.plans.newest_id, int(status["plan"])
        if newest > int(status["offer"]):
            return False  # the last one has not been looked at
        must_stop = bool(status["must_stop"])
        if not plan:
            return bool(status["ready"]) and not status["pending"] and not must_stop
        last = int(status["pending"]) or plan
        if status["state"] not in (State.STREAMING, State.HOLD) or last not in self._made:
            return False
        ticket = self._made[last][0]
        if must_stop:
            return not ticket.stops and not status["plan_over"]
        if self._is_new(target, status):
            return True
        if status["pending"]:
            return False
        if ticket.partial:
            return True
        if ticket.source_over:
            return False
        tick, refused = int(status["tick"]) + 1, newest != plan
        unplayed = self._made[plan][1].start_tick + self._made[plan][1].stop_row - tick
        return refused or tick >= self._asked_tick + self._replan_ticks or unplayed < self._least_unplayed

    def _is_new(self, target: Target, status: NDArray[Any]) -> bool:
        """Whether neither the plan that plays nor the one that waits follows this target."""
        return target.id > max(int(status["target"]), self._target_of(int(status["pending"])))

    def _target_of(self, plan: int) -> int:
        return self._made[plan][0].target if plan in self._made else 0

    def _playing_at(self, join: int, status: NDArray[Any]) -> int:
        """Id of the plan that will play just before tick `join`: what the new one goes on from."""
        pending = int(status["pending"])
        waits = pending in self._made and self._made[pending][1].start_tick < join
        return pending if waits else int(status["plan"])

    def _kind(self, status: NDArray[Any], target: Target) -> Kind:
        if status["must_stop"]:
            return Kind.STOP
        return Kind.PARTIAL if status["plan"] and self._is_new(target, status) else Kind.WHOLE

    def _check(self, kind: Kind, target: Target) -> None:
        """Drop what is being made as soon as something more urgent is asked for."""
        status = self.ticks.latest()
        stop = status is not None and bool(status["must_stop"]) and kind is not Kind.STOP
        # A plan for a target is soon made; were it dropped too, targets in quick succession would leave no plan at all.
        newer = kind is Kind.WHOLE and self._newest_target().id > target.id
        if stop or newer:
            raise Superseded

    def _newest_target(self) -> Target:
        """The target that counts; one that was refused counts no more."""
        target = self.targets.newest() if self._follows else NO_TARGET
        return NO_TARGET if target.id == self._refused else target

    def _turn_to(self, target: Target, current: Plan | None, join: int) -> bool:
        """Let the source follow a new target from the join on; False where it cannot."""
        source = self.planner.source
        assert isinstance(source, LiveSource)
        frame = self.planner.first_frame(join, current)
        played = None
        if current is not None and current.human is not None:
            place = frame - current.human_first_frame
            played = current.human[: place + 1] if 0 <= place < len(current.human) else None
        try:
            remark = source.turn_to(target, frame, played)
        except ConfigError as error:
            self._refused = target.id
            self.tell(str(error))
            return False
        if remark is not None:
            self.tell(remark)
        return True


def _effect_row(before: Plan, after: Plan) -> int:
    """First row of `after` at which a joint is sent elsewhere than `before` would have sent it; -1: none."""
    offset = after.start_tick - before.start_tick
    rows = np.minimum(np.arange(len(after)) + offset, len(before) - 1)
    differs = np.abs(after.q - before.q[rows]).max(axis=1) > EFFECT_RAD
    return int(np.argmax(differs)) if differs.any() else -1
