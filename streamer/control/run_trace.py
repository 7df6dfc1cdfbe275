"""`RunTrace`: what one run did, tick by tick; collected from the loop's telemetry, read by report, plots and log."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from flexmotion.streamer.control.telemetry import Event, Telemetry, events
from flexmotion.streamer.control.tick_row import REPAIRS, blank, tick_dtype

Float = NDArray[np.float64]

KEPT_S = 300.0
"""A record keeps the last five minutes of a run without an end: it must not grow for as long as a robot is on [s]."""
_EVENTS_KEPT = 10_000
_FIRST_ROWS = 4096

TorqueSource = Literal["simulation", "servos"]


@dataclass(frozen=True)
class PlanEvent:
    """One plan: when it was asked for and joined (ticks), and what it cost on the wall clock [s]."""

    asked_tick: int
    join_tick: int
    sample_s: float
    retarget_s: float


class RunTrace:
    """Rows of `flexmotion.streamer.control.tick_row.tick_dtype`, each column an attribute: `record.q` is (used, n).

    Args:
        kept_s: rows older than this are forgotten [s].

    Attributes:
        rate_hz: ticks per second.
        joint_names: the robot's joints in column order.
        events: in order of tick.
        human_steps: footsteps that the human made.
        forgotten: rows that were forgotten, or lost because nobody collected them in time.
    """

    def __init__(self, rate_hz: float, joint_names: tuple[str, ...], *, kept_s: float = KEPT_S) -> None:
        self.rate_hz, self.joint_names = rate_hz, joint_names
        self.events: deque[Event] = deque(maxlen=_EVENTS_KEPT)
        self.human_steps = 0
        self.forgotten = 0
        self._most = int(kept_s * rate_hz)
        self._rows = blank(tick_dtype(len(joint_names)), _FIRST_ROWS)
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
        """Twice the room, up to what is kept; then the older half is forgotten."""
        kept = self.rows
        if len(self._rows) >= self._most:
            kept = kept[len(kept) // 2 :]
            self.forgotten += self._used - len(kept)
        grown = blank(self._rows.dtype, max(min(2 * len(self._rows), self._most), len(kept) + count))
        grown[: len(kept)] = kept
        self._rows, self._used = grown, len(kept)

    def _last(self, name: str) -> int:
        return int(self.rows[name][-1]) if self._used else 0

    @property
    def hardware_failed(self) -> bool:
        """Whether servos, IMU, supply or bus are why the robot did not start, or why a fault is latched."""
        return bool(self._last("hardware_failed"))

    @property
    def torque_source(self) -> TorqueSource | None:
        """Who tells what torque the servos made: the simulation's truth, or they themselves, by their current."""
        if np.isfinite(self.rows["true_torque"]).any():
            return "simulation"
        return "servos" if np.isfinite(self.rows["effort"]).any() else None

    @property
    def torque(self) -> Float:
        """What the servos made, as `torque_source` tells, (used, n) [N·m]; NaN where unknown."""
        if self.torque_source == "servos":
            return np.where(self.rows["stale"] > 0, np.nan, self.rows["effort"])
        return self.rows["true_torque"]

    @property
    def plans(self) -> list[PlanEvent]:
        """The plans that were played, in order."""
        rows = self.rows[self.rows["plan"] > 0]
        _, first = np.unique(rows["plan"], return_index=True)
        return [
            PlanEvent(int(r["asked_tick"]), int(r["plan_start"]), float(r["sample_s"]), float(r["retarget_s"]))
            for r in rows[first]
        ]

    @property
    def repairs(self) -> dict[str, int]:
        """Repairs by kind, of planner and loop together."""
        return {kind: int(self.rows["repairs"][-1, i]) if self._used else 0 for i, kind in enumerate(REPAIRS)}

    @property
    def steps_planned(self) -> int:
        """Footsteps that the robot made."""
        return self._last("steps_planned")

    @property
    def steps_inserted(self) -> int:
        """Those of them that it made to set its feet right."""
        return self._last("steps_inserted")

    @property
    def missed_deadlines(self) -> int:
        """Ticks that were not done by the time of the next."""
        return self._last("missed_deadlines")

    @property
    def late_plans(self) -> int:
        """Plans that came too late to be played."""
        return self._last("late_plans")

    @property
    def underruns(self) -> int:
        """Times that the loop had to play a plan's own stop because no other had come."""
        return self._last("underruns")

    @property
    def violations_sent(self) -> int:
        """Goals outside a servo's envelope, counted where they arrive."""
        return self._last("violations")


class Collector:
    """Follows a loop's telemetry into a record."""

    def __init__(self, telemetry: Telemetry, record: RunTrace) -> None:
        self.record = record
        self._ticks, self._events = telemetry.ticks.reader(), telemetry.events.reader()

    def collect(self) -> list[Event]:
        """Take over what has been told since the last call; returns the new events."""
        lost = self._ticks.lost
        self.record.append(self._ticks.read())
        self.record.forgotten += self._ticks.lost - lost
        new = events(self._events)
        self.record.events.extend(new)
        return new
