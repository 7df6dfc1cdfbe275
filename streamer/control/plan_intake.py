"""`PlanIntake`: takes plans from the planner's buffer: one plays, the next takes over at its start tick."""

from __future__ import annotations

import numpy as np

from flexmotion.retarget.plan import Plan
from flexmotion.streamer.control.ladder import State
from flexmotion.streamer.control.plan_buffer import Offer, PlanBuffer
from flexmotion.streamer.control.telemetry import Telemetry

LATEST = 1
"""Ticks by which a plan may be late and is played all the same (docs/decisions.md)."""
_APART = np.radians(2.0)
"""Most that a late plan has left the one that plays, of any joint [rad]. In 147 plans for targets the joint that
differs most was .32 degrees away one tick after the join (median; most .99), the divergent component at most 1.7 mm."""

_STANDING = (State.READY, State.HOLD)
_PLAYING = (*_STANDING, State.STREAMING)


class PlanIntake:
    """Examines every plan once; where the robot must stop only plans that stop are played.

    A plan that comes up to `LATEST` ticks after its start is played from that row on, where it is hardly elsewhere than
    the plan that plays; any other late plan is refused.

    Args:
        plans: buffer that the planner publishes to.
        telemetry: counts of the row and events are written there.

    Attributes:
        playing: the plan that plays; `waiting`: the accepted plan that takes over at its start tick.
        examined: id of the newest plan that was accepted or refused.
    """

    def __init__(self, plans: PlanBuffer, telemetry: Telemetry) -> None:
        self.plans, self.telemetry = plans, telemetry
        self.playing: Offer | None = None
        self.waiting: Offer | None = None
        self.examined = 0
        self._underrun = 0  # id of the plan whose underrun was counted

    @property
    def plan(self) -> Plan | None:
        """The plan that plays."""
        return None if self.playing is None else self.playing.plan

    def over(self, tick: int) -> bool:
        """Whether the plan has been played to its last row."""
        return self.playing is not None and tick >= self.playing.plan.end_tick - 1

    def take(self, tick: int, state: State, *, must_stop: bool) -> Offer | None:
        """Let the waiting plan take over when its tick has come; a newer acceptable plan replaces it.

        Args:
            tick: number of this tick.
            state: the ladder's.
            must_stop: whether only a plan that stops is accepted.

        Returns:
            The plan that begins on this tick.
        """
        began = None
        if self.waiting is not None and state in _STANDING and must_stop and not self.waiting.ticket.halts:
            # Accepted before the stop was requested: a robot that stands does not start to walk after it.
            self.waiting = None
            self.plans.hold(self.playing, None)
        if self.waiting is not None and tick >= self.waiting.plan.start_tick:
            began = self._begin(self.waiting)
        offer = self.plans.newest(self.examined)
        if offer is None:
            return began
        # A plan that resumes the waiting plan is examined once that one plays.
        if self.waiting is None or offer.ticket.resumed != self.waiting.ticket.id:
            self.examined = offer.ticket.id
            if self._acceptable(offer, tick, state, must_stop):
                self.waiting = offer
                if tick >= offer.plan.start_tick:
                    began = self._begin(offer)
        self.plans.hold(self.playing, self.waiting)
        return began

    def forget(self) -> None:
        """No plan plays, and none waits."""
        self.playing = self.waiting = None
        self.plans.hold(None, None)

    def check_underrun(self, tick: int, *, must_stop: bool) -> None:
        """Count and warn once for each plan whose stop tail plays because no other plan came."""
        if self.playing is None:
            return
        ticket, plan = self.playing.ticket, self.playing.plan
        in_tail = plan.stop_row <= tick - plan.start_tick < len(plan)
        if in_tail and ticket.id != self._underrun and not (ticket.stops or ticket.source_over or must_stop):
            self._underrun = ticket.id
            self.telemetry.row.underruns += 1
            self.telemetry.emit(tick, "warning", f"no plan followed plan {ticket.id}: its own stop is played")

    def _begin(self, offer: Offer) -> Offer:
        self.playing, self.waiting = offer, None
        self.plans.hold(offer, None)
        return offer

    def _acceptable(self, offer: Offer, tick: int, state: State, must_stop: bool) -> bool:
        """Whether a plan may be played: it resumes the plan that plays, still joins it, and halts where it must."""
        if state not in _PLAYING:
            return False
        if offer.plan.start_tick < tick and not self._still_joins(offer, tick):
            # The planner makes another, which joins later.
            self.telemetry.row.late_plans += 1
            return False
        playing = 0 if self.playing is None else self.playing.ticket.id
        return offer.ticket.resumed == playing and (offer.ticket.halts or not must_stop)

    def _still_joins(self, offer: Offer, tick: int) -> bool:
        """Whether a plan that is late goes on where the one that plays is: the same feet, and joints close by."""
        late, current = tick - offer.plan.start_tick, self.plan
        if current is None or late > LATEST or late >= len(offer.plan):
            return False
        row = min(tick - current.start_tick, len(current) - 1)
        apart = np.abs(offer.plan.q[late] - current.q[row]).max()
        return bool(apart <= _APART and (offer.plan.contacts[late] == current.contacts[row]).all())
