"""`RunTrace`: one run, tick by tick; collected from the loop's telemetry, read by report, plots and log."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexmotion.streamer.control.plan_intake import LATEST
from flexmotion.streamer.control.run_totals import (
    OF_PLANS,
    JointSums,
    RunTotals,
    Times,
    TorqueSource,
    torque_source,
    torques,
)
from flexmotion.streamer.control.telemetry import Event, Telemetry, events
from flexmotion.streamer.control.tick_row import REPAIRS, TickRow, blank

Float = NDArray[np.float64]

KEPT_S = 300.0
"""Most of a run without an end that is kept, its last part, so that memory stays bounded; half of it at least [s]."""
_EVENTS_KEPT = 10_000
_FIRST_ROWS = 4096


@dataclass(frozen=True)
class PlanEvent:
    """One plan: when it was requested, was to join and joined (ticks), and its time to make on the wall clock [s]."""

    asked_tick: int
    start_tick: int
    join_tick: int
    sample_s: float
    retarget_s: float


class RunTrace:
    """Rows of `flexmotion.streamer.control.tick_row.TickRow`; each field is an attribute too: `record.q` is (used, n).

    The totals of the run (`repairs`, `steps_planned`, `missed_deadlines` …) have the names of the fields they are
    taken from; `ticks` has the fields themselves.

    Args:
        kept_s: where more would be kept, the older half is dropped [s]; `totals` has what is known of it.

    Attributes:
        rate_hz: ticks per second.
        joint_names: the robot's joints in column order.
        events: in order of tick.
        human_steps: footsteps that the human made; None if unknown.
        forgotten: rows that were dropped, or overwritten before they were collected.
        totals: of the rows that were dropped.
    """

    def __init__(self, rate_hz: float, joint_names: tuple[str, ...], *, kept_s: float = KEPT_S) -> None:
        self.rate_hz, self.joint_names = rate_hz, joint_names
        self.events: deque[Event] = deque(maxlen=_EVENTS_KEPT)
        self.human_steps: int | None = None
        self.forgotten = 0
        self.totals = RunTotals()
        self._most = int(kept_s * rate_hz)
        self._rows = blank(TickRow.dtype(joints=len(joint_names)), _FIRST_ROWS)
        self._used = 0

    @property
    def used(self) -> int:
        """Rows kept."""
        return self._used

    @property
    def cycles(self) -> int:
        """Ticks of the whole run, those forgotten included."""
        return self._used + self.forgotten

    @property
    def duration_s(self) -> float:
        """Length of the whole run [s]."""
        return (self._last("tick") + 1) / self.rate_hz if self._used else 0.0

    @property
    def rows(self) -> NDArray[Any]:
        """The rows kept, oldest first; a view."""
        return self._rows[: self._used]

    @property
    def ticks(self) -> TickRow:
        """The same rows, with their fields as attributes."""
        return TickRow(self.rows)

    def __getattr__(self, name: str) -> NDArray[Any]:
        rows = self.__dict__.get("_rows")
        if rows is None or name not in rows.dtype.names:
            raise AttributeError(f"{type(self).__name__} has no column {name!r}")
        return self.rows[name]

    def append(self, rows: NDArray[Any]) -> None:
        """Add rows, (k,)."""
        end = self._used + len(rows)
        if end > len(self._rows):
            self._make_room(len(rows))
            end = self._used + len(rows)
        self._rows[self._used : end] = rows
        self._used = end

    def _make_room(self, count: int) -> None:
        """Double the capacity, up to what is kept; from then on drop the older half."""
        kept = self.rows
        if len(self._rows) >= self._most:
            self.totals.fold(TickRow(kept[: len(kept) // 2]))
            kept = kept[len(kept) // 2 :]
            self.forgotten += self._used - len(kept)
        grown = blank(self._rows.dtype, max(min(2 * len(self._rows), self._most), len(kept) + count))
        grown[: len(kept)] = kept
        self._rows, self._used = grown, len(kept)

    def _last(self, name: str) -> int:
        return int(self.rows[name][-1]) if self._used else 0

    @property
    def hardware_failed(self) -> bool:
        """Whether servos, IMU, supply or bus are why the start was refused or a fault is latched."""
        return bool(self._last("hardware_failed"))

    @property
    def torque_source(self) -> TorqueSource | None:
        """Where `torque` comes from; None where it is unknown."""
        return torque_source(self.ticks) or self.totals.torque_source

    @property
    def torque(self) -> Float:
        """Torque of the servos according to `torque_source`, (used, n) [N·m]; NaN where unknown."""
        return torques(self.ticks, self.torque_source)

    @property
    def joint_sums(self) -> JointSums:
        """Loads of the joints in the whole run."""
        kept = JointSums.of(self.ticks, self.torque)
        return kept if self.totals.joints is None else self.totals.joints + kept

    def times(self, name: str) -> Times | Float:
        """A time of each tick, or of each plan, of the whole run: the times themselves while all rows are kept [s]."""
        kept = getattr(self.ticks, name)
        if name in OF_PLANS:
            kept = kept[self.totals.first_of_plans(self.ticks)]
        kept = np.asarray(kept, dtype=float)
        return self.totals.times[name].with_(kept) if self.totals.joints is not None else kept

    @property
    def plans_played(self) -> int:
        """Plans that were played in the whole run."""
        return self.totals.plans + len(self.totals.first_of_plans(self.ticks))

    @property
    def period_s(self) -> tuple[float, float]:
        """Part of the run whose rows are kept, from its first tick [s]."""
        first = int(self.rows["tick"][0]) if self._used and self.forgotten else 0
        return first / self.rate_hz, self.duration_s

    @property
    def time_s(self) -> Float:
        """Times of the rows kept, from the first tick of the run, (used,) [s]."""
        return self.period_s[0] + np.arange(self._used) / self.rate_hz

    @property
    def plans(self) -> list[PlanEvent]:
        """The plans that were played in the rows kept, in order."""
        rows = self.ticks[self.ticks.plan > 0]
        _, first = np.unique(rows.plan, return_index=True)
        found = []
        for row in map(rows.__getitem__, first):
            start = int(row.plan_start)
            late = min(max(int(row.tick) - start, 0), LATEST)  # rows of the plan before may be forgotten
            found.append(
                PlanEvent(int(row.asked_tick), start, start + late, float(row.sample_s), float(row.retarget_s))
            )
        return found

    @property
    def repairs(self) -> dict[str, int]:
        """Repairs by kind, of planner and loop together."""
        return {kind: int(self.ticks.repairs[-1, i]) if self._used else 0 for i, kind in enumerate(REPAIRS)}

    @property
    def steps_planned(self) -> int:
        """Footsteps that the robot made."""
        return self._last("steps_planned")

    @property
    def steps_inserted(self) -> int:
        """Those of them without a step of the human, that correct the feet."""
        return self._last("steps_inserted")

    @property
    def missed_deadlines(self) -> int:
        """Ticks that were not done when the next was due."""
        return self._last("missed_deadlines")

    @property
    def late_plans(self) -> int:
        """Plans that came too late to be played."""
        return self._last("late_plans")

    @property
    def underruns(self) -> int:
        """Plans whose own stop was played because no other plan came."""
        return self._last("underruns")

    @property
    def violations_sent(self) -> int:
        """Goals outside a servo's envelope that left the loop; see `Driver.violations`."""
        return self._last("violations")


class Collector:
    """Copies a loop's telemetry to a record."""

    def __init__(self, telemetry: Telemetry, record: RunTrace) -> None:
        self.record = record
        self._ticks, self._events = telemetry.ticks.reader(), telemetry.events.reader()

    def collect(self) -> list[Event]:
        """Copy what was published since the last call; returns the new events."""
        lost = self._ticks.lost
        self.record.append(self._ticks.read())
        self.record.forgotten += self._ticks.lost - lost
        new = events(self._events)
        self.record.events.extend(new)
        return new
