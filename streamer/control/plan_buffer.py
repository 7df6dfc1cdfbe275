"""`PlanBuffer`: plans from the planner to the loop through shared memory; neither waits for the other."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np

from flexmotion.configs.errors import RetargetError
from flexmotion.drivers.realtime.ring import fence, shared_array, touch
from flexmotion.records import Bool, Float, Int, Record, column
from flexmotion.retarget.plan import Plan
from flexmotion.retarget.steps import StepRecord, pack_steps
from flexmotion.streamer.control.tick_row import REPAIRS

SLOTS = 5
"""One plays, one waits for its tick, one is examined, one is newest, one is being written."""
MOST_STEPS = 16
_TAIL_S = 5.0
"""Room for what follows the horizon: steps under way, and the stop [s]."""


@dataclass(frozen=True)
class Ticket:
    """What the loop must know about a plan beside its rows: a value, unlike `PlanHead`, which is the memory.

    Attributes:
        id: number of the plan, from 1.
        resumed: id of the plan whose state it resumes; 0: the stand pose.
        asked_tick: tick at which it was requested.
        target: id of the newest target that it follows; 0: none.
        target_ns: when that target arrived (`time.perf_counter_ns`).
        effect_row: first row that differs from what the plan before would have sent; -1: none does.
        partial: it follows the source only for a moment; the whole plan comes right after it.
        stops: it comes to a stop, whatever the source has.
        source_over: the source has nothing after it.
        sample_s, retarget_s: time that it took to get the human motion, and to retarget it [s].
        leads: arms, head or a foot are led by a target in it: where it stops, they may still move.
        seen_ns: arrival of the newest frame of a mirrored person that it follows (`time.perf_counter_ns`); 0: none.
    """

    id: int
    resumed: int
    asked_tick: int
    target: int
    target_ns: int
    effect_row: int
    partial: bool
    stops: bool
    source_over: bool
    sample_s: float
    retarget_s: float
    leads: bool = False
    seen_ns: int = 0

    @property
    def halts(self) -> bool:
        """Whether it is the answer to a stop: all of the robot comes to rest."""
        return self.stops and not self.leads


_TICKET = tuple(field.name for field in fields(Ticket))


class PlanHead(Record):
    """A slot's head: the fields of `Ticket` and of `Plan` that a plan has once, and its steps."""

    id: Int = column("i8")
    resumed: Int = column("i8")
    asked_tick: Int = column("i8")
    target: Int = column("i8")
    target_ns: Int = column("i8")
    effect_row: Int = column("i8")
    partial: Bool = column("?")
    stops: Bool = column("?")
    source_over: Bool = column("?")
    leads: Bool = column("?")
    sample_s: Float = column("f8")
    retarget_s: Float = column("f8")
    seen_ns: Int = column("i8")
    start_tick: Int = column("i8")
    stop_row: Int = column("i8")
    length: Int = column("i8")
    """Rows used, of the plan and (`step_count`) of `steps`."""
    step_count: Int = column("i8")
    steps: StepRecord = column(StepRecord, MOST_STEPS)
    torque_cap: Float = column("f8", "joints")
    asked_cap: Float = column("f8", "joints")


class PlanRows(Record):
    """A slot's rows: the arrays of `Plan`, one row a tick."""

    q: Float = column("f8", "joints")
    qd: Float = column("f8", "joints")
    qdd: Float = column("f8", "joints")
    torque: Float = column("f8", "joints")
    stiffness: Float = column("f8", "joints")
    feet: Float = column("f8", 2, 4)
    base: Float = column("f8", 7)
    com: Float = column("f8", 3)
    com_velocity: Float = column("f8", 3)
    zmp: Float = column("f8", 2)
    dcm: Float = column("f8", 2)
    load_share: Float = column("f8")
    source_s: Float = column("f8")
    hand_error: Float = column("f8", 2)
    states: Float = column("f8", "state")
    repairs: Int = column("i8", len(REPAIRS))
    """By kind, in the order of `REPAIRS`."""
    contacts: Bool = column("?", 2)


@dataclass(frozen=True)
class Offer:
    """A plan in the buffer; its arrays are views that stay as they are while the loop holds the slot."""

    ticket: Ticket
    plan: Plan
    slot: int


class PlanBuffer:
    """Slots of shared memory: the planner writes to one that is not in use, the loop marks those that are.

    Args:
        joints: of the robot.
        state: length of the retargeter's state, in numbers.
        horizon: rows of a plan before its stop tail.
        rate_hz: rows a second.
    """

    def __init__(self, joints: int, state: int, horizon: int, rate_hz: float) -> None:
        self.rows = horizon + round(_TAIL_S * rate_hz)
        row = PlanRows.dtype(joints=joints, state=state)
        # An array a field: contiguous, as the loop and the planner read them.
        self._rows = [
            PlanRows({name: shared_array((self.rows, *row[name].shape), row[name].base) for name in PlanRows.names()})
            for _ in range(SLOTS)
        ]
        self._heads = PlanHead(shared_array(SLOTS, PlanHead.dtype(joints=joints)))
        self._newest = shared_array(1, np.int64)  # id of the newest plan; its slot is in `_slot`
        self._slot = shared_array(1, np.int64)
        self._held = shared_array(3, np.int64)  # slots that the loop plays, keeps for its tick, and examines
        self._newest[0], self._slot[0], self._held[:] = 0, -1, -1

    def touch(self) -> None:
        """Read all of it once, see `flexmotion.drivers.realtime.ring.touch`."""
        for rows in self._rows:
            for _, values in rows:
                touch(values)

    @property
    def newest_id(self) -> int:
        """Id of the newest plan published; 0 before the first."""
        return int(self._newest[0])

    # ---------------------------------------------------------------- the planner's side

    def publish(self, ticket: Ticket, plan: Plan) -> None:
        """Offer a plan.

        Raises:
            RetargetError: it is longer than a slot.
        """
        if len(plan) > self.rows or len(plan.steps) > MOST_STEPS:
            raise RetargetError(
                f"plan for tick {plan.start_tick}: {len(plan)} rows and {len(plan.steps)} steps, "
                f"a slot holds {self.rows} and {MOST_STEPS}"
            )
        slot = self._free()
        rows, head, length = self._rows[slot], self._heads[slot], len(plan)
        for name, values in rows:
            if name != "repairs":
                values[:length] = getattr(plan, name)
        for index, kind in enumerate(REPAIRS):
            rows.repairs[:length, index] = plan.repairs[kind]
        for name in _TICKET:
            setattr(head, name, getattr(ticket, name))
        head.start_tick[...], head.stop_row[...], head.length[...] = plan.start_tick, plan.stop_row, length
        head.step_count[...] = len(plan.steps)
        head.steps[: len(plan.steps)] = pack_steps(plan.steps)
        head.torque_cap[...], head.asked_cap[...] = plan.torque_cap, plan.asked_cap
        fence()
        self._slot[0] = slot
        fence()
        self._newest[0] = ticket.id

    def _free(self) -> int:
        """A slot that is neither newest nor held; there is always one."""
        used = {int(self._slot[0]), *self._held.tolist()}
        return next(slot for slot in range(SLOTS) if slot not in used)

    def playing(self) -> Offer | None:
        """A copy of the plan that the loop plays, for a planner that succeeds another one; None: it plays none.

        Its human is not in the memory. The planner that wrote it must have ended.
        """
        slot = int(self._held[0])
        return None if slot < 0 else _copy(self._offer(slot))

    # ---------------------------------------------------------------- the loop's side

    def newest(self, seen: int) -> Offer | None:
        """The newest plan, if it is newer than the id `seen`; call `hold` before the next call of this."""
        if self.newest_id <= seen:
            return None
        fence()
        while True:
            slot = int(self._slot[0])
            self._held[2] = slot
            fence()
            # If the planner has published another one meanwhile, it may not have seen that this slot is held.
            if slot == int(self._slot[0]):
                return self._offer(slot)

    def hold(self, playing: Offer | None, waiting: Offer | None) -> None:
        """Mark the plans that the loop still reads; the slots of all others may be written to."""
        self._held[0] = -1 if playing is None else playing.slot
        self._held[1] = -1 if waiting is None else waiting.slot
        self._held[2] = -1

    # ---------------------------------------------------------------- an observer's side

    def observe(self, seen: int) -> Offer | None:
        """A copy of the newest plan, if it is newer than the id `seen`; neither planner nor loop sees this reader.

        None also where the slot was written to meanwhile: a newer plan is there, ask again.
        """
        if self.newest_id <= seen:
            return None
        slot = int(self._slot[0])
        fence()
        copy = _copy(self._offer(slot))
        fence()
        # The newest slot is never written to. Had it been newest, written to and newest again, its id would differ.
        unchanged = slot == int(self._slot[0]) and copy.ticket.id == int(self._heads[slot].id)
        return copy if unchanged else None

    def _offer(self, slot: int) -> Offer:
        head = self._heads[slot]
        rows = self._rows[slot][: int(head.length)]
        arrays: dict[str, Any] = {name: values for name, values in rows if name != "repairs"}
        plan = Plan(
            start_tick=int(head.start_tick),
            stop_row=int(head.stop_row),
            repairs={kind: rows.repairs[:, index] for index, kind in enumerate(REPAIRS)},
            steps=head.steps[: int(head.step_count)].steps(),
            torque_cap=head.torque_cap,
            asked_cap=head.asked_cap,
            **arrays,
        )
        return Offer(Ticket(**{name: getattr(head, name).item() for name in _TICKET}), plan, slot)


def _copy(offer: Offer) -> Offer:
    arrays: dict[str, Any] = {
        name: value.copy() for name, value in vars(offer.plan).items() if isinstance(value, np.ndarray)
    }
    repairs = {kind: counts.copy() for kind, counts in offer.plan.repairs.items()}
    return replace(offer, plan=replace(offer.plan, repairs=repairs, **arrays))
