"""`waits_of`: what each target of a run waited for, from the loop's rows."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from flexmotion.streamer.checks.machine_pace import MachinePace
from flexmotion.streamer.control.run_trace import RunTrace


@dataclass(frozen=True)
class Wait:
    """The time from the arrival of a target to its first command [ms].

    Attributes:
        target: its number.
        total_ms: the whole time.
        begin_ms: until its plan was begun, to a tick; the rest of that tick counts to `join_ms`.
        sample_ms, retarget_ms: its plan was made.
        join_ms: the rest: its words were read, and the plan waited for its first tick.
        off_pace_ms: part of the whole in which the machine stood still or was slow; NaN: not known.
    """

    target: int
    total_ms: float
    begin_ms: float
    sample_ms: float
    retarget_ms: float
    join_ms: float
    off_pace_ms: float


def waits_of(record: RunTrace, pace: MachinePace | None) -> list[Wait]:
    """The targets that were followed in the rows kept, in order."""
    seconds = record.target_to_command_s
    off_pace = np.full(record.used, np.nan) if pace is None else pace.off_pace(seconds)
    found = []
    for place in np.flatnonzero(np.isfinite(seconds)):
        row = record.ticks[place]
        sent_ns = int(row.stamp_ns) - round(1e9 * float(seconds[place]))
        # A plan is begun between the tick before the one that it was asked for and that one.
        before = int(np.searchsorted(record.rows["tick"], int(row.asked_tick))) - 1
        begun_ns = int(record.stamp_ns[max(before, 0)])
        begin_ms = max(begun_ns - sent_ns, 0) * 1e-6
        made = 1e3 * float(row.sample_s), 1e3 * float(row.retarget_s)
        total_ms = 1e3 * float(seconds[place])
        rest_ms = total_ms - begin_ms - sum(made)
        found.append(Wait(int(row.target), total_ms, begin_ms, *made, rest_ms, 1e3 * float(off_pace[place])))
    return found
