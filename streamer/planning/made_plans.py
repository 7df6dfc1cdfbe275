"""`MadePlans`: the plans that were made, from the one that plays on: which of them plays when, for which target."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from flexmotion.retarget.plan import Plan
from flexmotion.streamer.control.plan_buffer import Ticket
from flexmotion.streamer.control.tick_row import TickRow

EFFECT_RAD = np.radians(2.0)
"""A joint that is sent this much elsewhere shows a target's effect (the report's definition)."""


class MadePlans:
    """Plans by id, with their tickets. The one that plays can always be resumed, however many were refused since.

    Args:
        commit_ticks: a redraw may not replace the first moments of the plan before it; these many ticks.
    """

    def __init__(self, commit_ticks: int) -> None:
        self._commit_ticks = commit_ticks
        self._plans: dict[int, tuple[Ticket, Plan]] = {}

    def __contains__(self, plan: int) -> bool:
        return plan in self._plans

    def ticket(self, plan: int) -> Ticket:
        """The ticket of a plan. Raises `KeyError` if it is not known."""
        return self._plans[plan][0]

    def plan(self, plan: int) -> Plan | None:
        """A plan by its id; None where it is not known."""
        return self._plans[plan][1] if plan in self._plans else None

    def add(self, ticket: Ticket, plan: Plan, playing: int) -> None:
        """Keep a new plan, and forget those before the one that plays."""
        self._plans[ticket.id] = ticket, plan
        self._plans = {key: made for key, made in self._plans.items() if key >= playing}

    def begin_with(self, ticket: Ticket, plan: Plan) -> None:
        """Keep one plan alone: another process made it."""
        self._plans = {ticket.id: (ticket, plan)}

    def target_of(self, plan: int) -> int:
        """Id of the target that a plan follows; 0: none."""
        return self._plans[plan][0].target if plan in self._plans else 0

    def playing_at(self, join: int, row: TickRow) -> int:
        """Id of the plan that will play just before tick `join`, which a new one resumes."""
        pending = self.plan(int(row.pending))
        waits = pending is not None and pending.start_tick < join
        return int(row.pending) if waits else int(row.plan)

    def join(self, join: int, row: TickRow, *, redraws: bool) -> tuple[int, int, Plan | None]:
        """First tick from `join` on at which a plan may take over; id and rows of the plan that plays until then.

        Args:
            redraws: the new plan follows what the one before it did; those of a target or a stop join at once.
        """
        # A plan that begins with the one that waits could not come late: by then that one plays.
        resumed = self.playing_at(join if redraws else join + 1, row)
        current = self._plans[resumed][1] if resumed else None
        if current is not None:
            join = max(join, current.start_tick + (self._commit_ticks if redraws else 1))
        return join, resumed, current

    def pose(self, row: TickRow, tick: int) -> NDArray[np.float64] | None:
        """All joint angles as planned at a tick, (n,) [rad]; None before the first plan."""
        plan = self.plan(self.playing_at(tick, row))
        if plan is None:
            return None
        angles: NDArray[np.float64] = plan.q[min(max(tick - plan.start_tick, 0), len(plan) - 1)]
        return angles

    def lands_in(self, row: TickRow) -> int:
        """Ticks until the foot in the air lands, by the plan that plays; 0: both stand, or the plan is not known."""
        plan = self.plan(int(row.plan))
        if plan is None or row.contact_ref.all():
            return 0
        # A robot that is frozen on one foot has come past the end of its plan: nothing lands any more.
        stands = plan.contacts[max(int(row.tick) - plan.start_tick, 0) :].all(axis=1)
        return int(np.argmax(stands)) if stands.any() else 0

    def start_of(self, row: TickRow, target: int) -> int:
        """First tick of the plan by which the loop follows a target: the one that plays, or the one that waits."""
        plan = self.plan(int(row.plan) if int(row.target) >= target else int(row.pending))
        return int(row.plan_start) if plan is None else plan.start_tick


def effect_row(before: Plan, after: Plan) -> int:
    """First row of `after` at which a joint is sent elsewhere than `before` would have sent it; -1: none."""
    offset = after.start_tick - before.start_tick
    rows = np.minimum(np.arange(len(after)) + offset, len(before) - 1)
    differs = np.abs(after.q - before.q[rows]).max(axis=1) > EFFECT_RAD
    return int(np.argmax(differs)) if differs.any() else -1
