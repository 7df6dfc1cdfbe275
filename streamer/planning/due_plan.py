"""`DuePlan`: whether a plan is to be made now, and of which kind, from the loop's newest row."""

from __future__ import annotations

from typing import Protocol

from flexmotion.streamer.control.ladder import State
from flexmotion.streamer.control.plan_buffer import PlanBuffer
from flexmotion.streamer.control.tick_row import TickRow
from flexmotion.streamer.motion.targets import Target
from flexmotion.streamer.planning.foot_targets import FootTargets
from flexmotion.streamer.planning.head_targets import HeadTargets
from flexmotion.streamer.planning.lead import Kind
from flexmotion.streamer.planning.made_plans import MadePlans
from flexmotion.streamer.planning.mirroring import Mirroring
from flexmotion.streamer.planning.part_targets import PartTargets
from flexmotion.streamer.planning.push_watch import PushWatch
from flexmotion.streamer.planning.restriction_targets import RestrictionTargets
from flexmotion.streamer.planning.step_runner import StepRunner
from flexmotion.streamer.planning.target_ledger import TargetLedger


class Records(Protocol):
    """What the planner knows of its plans, and of what operators ask for."""

    plans: PlanBuffer
    made: MadePlans
    ledger: TargetLedger
    parts: PartTargets
    feet: FootTargets
    head: HeadTargets
    restrictions: RestrictionTargets
    push: PushWatch


class DuePlan:
    """Decides; makes none.

    Args:
        records: the planner's.
        runner: of the source's programs; None: it has none.
        mirroring: of the person who is seen; None: the source follows none.
        replan_ticks: between two plans for which nothing new is asked.
        least_unplayed: part of a plan that is left to play when the next one is made [ticks].

    Attributes:
        asked_tick: at which the last plan was made; whoever makes plans sets it.
    """

    def __init__(
        self,
        records: Records,
        runner: StepRunner | None,
        mirroring: Mirroring | None,
        *,
        replan_ticks: int,
        least_unplayed: int,
    ) -> None:
        self.records, self.runner, self.mirroring = records, runner, mirroring
        self.asked_tick = 0
        self._replan_ticks, self._least_unplayed = replan_ticks, least_unplayed

    def now(self, row: TickRow, target: Target) -> bool:
        """Whether a plan is to be made now.

        Args:
            row: newest one of the loop.
            target: that plans should follow.
        """
        newest, plan = self.records.plans.newest_id, int(row.plan)
        if newest > int(row.offer):
            return False  # the loop has not examined the last one
        if not plan:
            return self._first(row, target)
        last = int(row.pending) or plan
        if int(row.state) not in (State.STREAMING, State.HOLD) or last not in self.records.made:
            return False
        ticket = self.records.made.ticket(last)
        if row.must_stop:
            return not (ticket.halts or row.plan_over)
        if self.is_new(target, row) or self._beside(row, last):
            return True
        if self.records.ledger.halted:
            return not (ticket.stops or ticket.source_over or row.plan_over)
        if row.pending:
            return False
        if self.changes:
            return True
        if self.rests:
            over = self.runner is not None and self.runner.over
            return not (ticket.stops or row.plan_over) or (over and not ticket.source_over)
        if ticket.partial or (self.mirroring is not None and self.mirroring.fresh):
            return True
        return not ticket.source_over and (self.records.push.sway is not None or self._goes_on(row))

    def urgent(self, row: TickRow, target: Target) -> bool:
        """Whether somebody waits for a plan: for a stop, or for something new; arguments of `now`."""
        last, tick = int(row.pending) or int(row.plan), int(row.tick) + 1
        beside = any(records.wants(last, tick) for records in self._records_beside)
        return bool(row.must_stop) or self.is_new(target, row) or self.changes or beside

    def kind(self, row: TickRow, target: Target) -> Kind:
        """The kind of plan that is due; arguments of `now`."""
        new = self.is_new(target, row)
        changes = new or self.changes
        if row.must_stop or (self.records.ledger.halted and not new) or (self.rests and not changes):
            return Kind.STOP
        # Where torques are capped a plan is judged before any of it is played.
        short = row.plan and changes and not self.records.restrictions.restrictions.caps
        return Kind.PARTIAL if short else Kind.WHOLE

    def is_new(self, target: Target, row: TickRow) -> bool:
        """Whether neither the plan that plays nor the one that waits follows this target."""
        return target.id > max(int(row.target), self.records.made.target_of(int(row.pending)))

    @property
    def rests(self) -> bool:
        """Whether a program has the robot stand until it is measured, or nobody is there to be mirrored."""
        runner, mirroring = self.runner, self.mirroring
        return (runner is not None and runner.resting) or (mirroring is not None and mirroring.resting)

    @property
    def changes(self) -> bool:
        """Whether the source is to go on with the next step of a program, or with a person who has come."""
        runner, mirroring = self.runner, self.mirroring
        return (runner is not None and runner.wanted is not None) or (mirroring is not None and mirroring.wanted)

    def _first(self, row: TickRow, target: Target) -> bool:
        """Whether a plan is due where none plays."""
        tick = int(row.tick) + 1
        beside = any(records.wants(0, tick) for records in self._records_beside)
        halted = self.records.ledger.halted and not (self.is_new(target, row) or beside)
        return bool(row.ready and not row.pending and not row.must_stop and not halted)

    def _beside(self, row: TickRow, last: int) -> bool:
        """Whether arms, head, feet or restrictions ask for a plan: one that knows all, or goes on in a stand."""
        tick = int(row.tick) + 1
        if row.pending:
            return False
        if any(records.wants(last, tick) for records in self._records_beside):
            return True
        if self.records.restrictions.inherits:
            return False  # a plan would lift the caps, though nobody asks for anything; arms stay where they are
        plan = self.records.made.plan(last)
        if plan is None:
            return False
        moves = self.records.parts.moves(plan, max(plan.end_tick, tick)) or self.records.feet.is_coming(plan)
        return moves and tick >= self.asked_tick + self._replan_ticks

    @property
    def _records_beside(self) -> tuple[PartTargets, FootTargets, HeadTargets, RestrictionTargets]:
        """What is asked for beside the target for the whole body."""
        return self.records.parts, self.records.feet, self.records.head, self.records.restrictions

    def _goes_on(self, row: TickRow) -> bool:
        """Whether the motion that plays is to be planned further."""
        tick, refused = int(row.tick) + 1, self.records.plans.newest_id != int(row.plan)
        playing = self.records.made.plan(int(row.plan))
        assert playing is not None
        if playing.eased is not None and playing.eased.refused and not refused:
            return tick >= self.asked_tick + self._replan_ticks
        unplayed = playing.start_tick + playing.stop_row - tick
        return refused or tick >= self.asked_tick + self._replan_ticks or unplayed < self._least_unplayed
