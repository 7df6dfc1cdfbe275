"""Standstills of the machine itself, compared with the ticks of a run."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from flexmotion.drivers.realtime.witness import overlapping
from flexmotion.streamer.checks.latency_result import Standstills
from flexmotion.streamer.control.run_trace import RunTrace
from flexmotion.streamer.report.report import Latency

_SOON_S, _LONG_S = 2.0, 0.02
"""A standstill that ended at most so long before a fault, and lasted so long, may be its cause [s]."""


class StandstillTimes:
    """The machine's standstills during a run.

    Args:
        record: the run.
        found: begin and end of each standstill, (k, 2) [ns, `perf_counter_ns`].
        stolen_ms: time that the host took meanwhile [ms].

    Attributes:
        summary: counts and durations.
    """

    def __init__(self, record: RunTrace, found: NDArray[np.int64], stolen_ms: float) -> None:
        first, last = (int(record.stamp_ns[at]) for at in (0, -1))
        self._stamps = record.stamp_ns
        self._spans = found[(found[:, 1] > first) & (found[:, 0] < last)]
        ms = (self._spans[:, 1] - self._spans[:, 0]) * 1e-6
        # A tick that woke late ends late and misses the next deadline: a deadline counts from the one before it on.
        missed = np.diff(record.rows["missed_deadlines"], prepend=0)
        since = np.concatenate([[first], self._stamps[:-1] - _ns(record.lateness_s[:-1])])
        missed_then = int(missed[overlapping(since, self._stamps, self._spans)].sum())
        longest = float(ms.max(initial=0.0))
        self.summary = Standstills(len(ms), float(ms.sum()), longest, missed_then, stolen_ms)

    def just_before(self, stamp_ns: int) -> str:
        """The longest standstill shortly before `stamp_ns`, as the end of a message; empty if none was long."""
        ended = (self._spans[:, 1] > stamp_ns - _ns(_SOON_S)) & (self._spans[:, 0] < stamp_ns)
        longest = max(self._spans[ended].tolist(), key=lambda span: span[1] - span[0], default=[0, 0])
        stood_s, ago_s = 1e-9 * (longest[1] - longest[0]), 1e-9 * (stamp_ns - longest[1])
        if stood_s < _LONG_S:
            return ""
        return f", {max(ago_s, 0.0):.2f} s after the machine itself stood still for {1e3 * stood_s:.0f} ms"

    def apart(self, seconds: NDArray[np.float64], after: NDArray[np.float64] | float = 0.0) -> Latency | None:
        """Percentiles of a time without the ticks in which the machine stood still.

        Args:
            seconds: the time in each tick, (T,) [s].
            after: how much of it lies after the tick's wake, (T,) or one for all [s].
        """
        end = self._stamps + _ns(after)
        return Latency.of(seconds[~overlapping(end - _ns(seconds), end, self._spans)], 1e-3)


def _ns(seconds: NDArray[np.float64] | float) -> NDArray[np.int64]:
    return np.asarray(np.nan_to_num(np.asarray(seconds) * 1e9), np.int64)
