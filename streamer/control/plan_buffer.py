"""`PlanBuffer`: plans from the planner to the loop through shared memory; neither waits for the other."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np

from flexmotion.configs.errors import RetargetError
from flexmotion.drivers.realtime.ring import fence, shared_array, touch
from flexmotion.retarget.plan import Plan
from flexmotion.retarget.steps import StepRecord, pack_steps
from flexmotion.streamer.control.tick_row import REPAIRS

SLOTS = 5
"""One plays, one waits for its tick, one is looked at, one is newest, one is being written."""
MOST_STEPS = 16
_TAIL_S = 5.0
"""Room for what follows the horizon: steps under way, and the stop [s]."""
_JOINTS = ("q", "qd", "qdd", "torque")


@dataclass(frozen=True)
class Ticket:
    """What the loop must know about a plan beside its rows.

    Attributes:
        id: number of the plan, from 1.
        resumed: id of the plan whose state it resumes; 0: the stand pose.
        asked_tick: tick at which it was asked for.
        target: id of the newest target that it follows; 0: none.
        target_ns: when that target arrived (`time.perf_counter_ns`).
        effect_row: first row that differs from what the plan before would have sent; -1: none does.
        partial: it follows the source for a moment only; the whole plan comes at once.
        stops: it comes to a stop whatever the source has.
        source_over: the source has nothing after it.
        sample_s, retarget_s: time it took to get the human motion, and to retarget it [s].
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


@dataclass(frozen=True)
class Offer:
    """A plan in the buffer; its arrays are views that stay as they are while the loop holds the slot."""

    ticket: Ticket
    plan: Plan
    slot: int


class PlanBuffer:
    """Slots of shared memory: the planner writes to one that is not in use, the loop says which are.

    Args:
        joints: of the robot; state: length of the retargeter's state; horizon: rows of a plan before its stop tail.
        rate_hz: rows a second.
    """

    def __init__(self, joints: int, state: int, horizon: int, rate_hz: float) -> None:
        self.rows = horizon + round(_TAIL_S * rate_hz)
        row = np.dtype(
            [
                *((name, "f8", joints) for name in _JOINTS),
                ("feet", "f8", (2, 4)),
                ("base", "f8", 7),
                ("com", "f8", 3),
                ("com_velocity", "f8", 3),
                ("zmp", "f8", 2),
                ("dcm", "f8", 2),
                ("load_share", "f8"),
                ("source_s", "f8"),
                ("hand_error", "f8", 2),
                ("states", "f8", state),
                ("repairs", "i8", len(REPAIRS)),
                ("contacts", "?", 2),
            ]
        )
        head = np.dtype(
            [
                *((f.name, {"int": "i8", "float": "f8", "bool": "?"}[str(f.type)]) for f in fields(Ticket)),
                *((name, "i8") for name in ("start_tick", "stop_row", "length", "step_count")),
                ("steps", StepRecord.dtype(), MOST_STEPS),
            ]
        )
        self._row_names = [name for name in row.names or () if name != "repairs"]
        # A column a field: contiguous, as the loop and the planner read them.
        self._columns = [
            {name: shared_array((self.rows, *row[name].shape), row[name].base) for name in row.names or ()}
            for _ in range(SLOTS)
        ]
        self._heads = shared_array(SLOTS, head)
        self._newest = shared_array(1, np.int64)  # id of the newest plan; its slot is in `_slot`
        self._slot = shared_array(1, np.int64)
        self._held = shared_array(3, np.int64)  # slots that the loop plays, keeps for its tick, and looks at
        self._newest[0], self._slot[0], self._held[:] = 0, -1, -1

    def touch(self) -> None:
        """Read all of it once, see `flexmotion.drivers.realtime.ring.touch`."""
        for columns in self._columns:
            for column in columns.values():
                touch(column)

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
        columns, head, length = self._columns[slot], self._heads[slot : slot + 1], len(plan)
        for name in self._row_names:
            columns[name][:length] = getattr(plan, name)
        for index, kind in enumerate(REPAIRS):
            columns["repairs"][:length, index] = plan.repairs[kind]
        for field in fields(Ticket):
            head[field.name] = getattr(ticket, field.name)
        head["start_tick"], head["stop_row"], head["length"] = plan.start_tick, plan.stop_row, length
        head["step_count"] = len(plan.steps)
        StepRecord(head["steps"][0])[: len(plan.steps)] = pack_steps(plan.steps)
        fence()
        self._slot[0] = slot
        fence()
        self._newest[0] = ticket.id

    def _free(self) -> int:
        """A slot that is neither newest nor held; there is always one."""
        used = {int(self._slot[0]), *self._held.tolist()}
        return next(slot for slot in range(SLOTS) if slot not in used)

    # ---------------------------------------------------------------- the loop's side

    def newest(self, seen: int) -> Offer | None:
        """The newest plan, if it is newer than the id `seen`; hold it or look away before the next call."""
        if self.newest_id <= seen:
            return None
        fence()
        while True:
            slot = int(self._slot[0])
            self._held[2] = slot
            fence()
            # Had the planner gone on meanwhile it might not have seen that this slot is in use.
            if slot == int(self._slot[0]):
                return self._offer(slot)

    def hold(self, playing: Offer | None, waiting: Offer | None) -> None:
        """Say which plans the loop still reads; the others' slots may be written to."""
        self._held[0] = -1 if playing is None else playing.slot
        self._held[1] = -1 if waiting is None else waiting.slot
        self._held[2] = -1

    # ---------------------------------------------------------------- an observer's side

    def observe(self, seen: int) -> Offer | None:
        """A copy of the newest plan, if it is newer than the id `seen`, for one whom neither side knows of.

        None also where the slot was written to meanwhile: a newer plan is there, ask again.
        """
        if self.newest_id <= seen:
            return None
        slot = int(self._slot[0])
        fence()
        copy = _copy(self._offer(slot))
        fence()
        # The newest slot is never written to. Had it been newest, written to and newest again, its id would differ.
        unchanged = slot == int(self._slot[0]) and copy.ticket.id == int(self._heads[slot]["id"])
        return copy if unchanged else None

    def _offer(self, slot: int) -> Offer:
        columns, head = self._columns[slot], self._heads[slot]
        length = int(head["length"])
        rows: dict[str, Any] = {name: columns[name][:length] for name in self._row_names}
        plan = Plan(
            start_tick=int(head["start_tick"]),
            stop_row=int(head["stop_row"]),
            repairs={kind: columns["repairs"][:length, index] for index, kind in enumerate(REPAIRS)},
            steps=StepRecord(head["steps"])[: int(head["step_count"])].steps(),
            **rows,
        )
        return Offer(Ticket(**{field.name: head[field.name].item() for field in fields(Ticket)}), plan, slot)


def _copy(offer: Offer) -> Offer:
    arrays: dict[str, Any] = {
        name: value.copy() for name, value in vars(offer.plan).items() if isinstance(value, np.ndarray)
    }
    return replace(offer, plan=replace(offer.plan, **arrays))
