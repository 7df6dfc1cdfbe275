"""`MachinePace`: when the machine itself stood still or was slow, compared with the ticks of a run."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from flexmotion.drivers.realtime.witness import Witness, covered
from flexmotion.streamer.checks.latency_result import Slowness, Standstills
from flexmotion.streamer.control.run_trace import RunTrace

Float = NDArray[np.float64]
Int = NDArray[np.int64]

_NONE = np.empty((0, 2), np.int64)
_SOON_S, _LONG_S = 2.0, 0.02
"""A standstill that ended at most so long before a fault, and lasted so long, may be its cause [s]."""
_SHARE = 0.05
"""A time does not count when the machine stood still or was slow for more than this share of it."""
_GROWS, _AT_LEAST = 2.0, 0.02
"""Slowness is the program's own where its share of the run is more than `_GROWS` times its share of the idle machine,
and `_AT_LEAST` more."""


class MachinePace:
    """The times of a run in which the machine did not keep its pace.

    Args:
        record: the run.
        stood: begin and end of each standstill of a processor, (k, 2) sorted by begin [ns, `perf_counter_ns`].
        slow: begin and end of each time in which all processors were slow, likewise; before the run too.
        idle: begin and end of the time before the run in which the machine was idle [ns].
        stolen_ms: time that the host took meanwhile [ms].

    Attributes:
        standstills, slowness: counts and durations.
        kept: whether the machine kept its pace during each tick, (T,).
    """

    def __init__(
        self,
        record: RunTrace,
        stood: Int,
        slow: Int = _NONE,
        *,
        idle: tuple[int, int] = (0, 0),
        stolen_ms: float = 0.0,
    ) -> None:
        self._stamps = record.stamp_ns
        first, last = int(self._stamps[0]), int(self._stamps[-1])
        self._stood = _between(stood, first, last)
        idle_slow, share = _share(slow, *idle), _share(slow, first, last)
        slow = _between(slow, first, last)
        ours = share > _GROWS * idle_slow + _AT_LEAST
        self._spans = self._stood if ours else np.concatenate([self._stood, slow])
        self._spans = self._spans[np.argsort(self._spans[:, 0], kind="stable")]
        # A tick that woke late ends late and misses the next deadline: a deadline counts from the one before it on.
        self._since = np.concatenate([[first], self._stamps[:-1] - _ns(record.lateness_s[:-1])])
        self._missed = np.diff(record.rows["missed_deadlines"], prepend=0)
        excused = covered(self._since, self._stamps, self._spans) > 0
        self.missed_kept = int(self._missed[~excused].sum())
        self.kept = covered(self._since, self._stamps, self._spans) <= _SHARE * (self._stamps - self._since)
        ms = np.diff(self._stood, axis=1) * 1e-6
        self.standstills = Standstills(
            count=len(ms),
            total_ms=float(ms.sum()),
            longest_ms=float(ms.max(initial=0.0)),
            missed_deadlines=int(self._missed[covered(self._since, self._stamps, self._stood) > 0].sum()),
            stolen_ms=stolen_ms,
        )
        ms = np.diff(slow, axis=1) * 1e-6
        self.slowness = Slowness(
            count=len(ms), longest_ms=float(ms.max(initial=0.0)), share=share, idle_share=idle_slow, ours=ours
        )

    @classmethod
    def of(cls, record: RunTrace, witness: Witness, stolen_ms: float) -> MachinePace | None:
        """What a witness saw during a run; None where it was not granted its priority, or there was no tick."""
        stood, slow = witness.standstills(), witness.slowness()
        if stood is None or slow is None or not record.used:
            return None
        return cls(record, stood, slow, idle=witness.idle_ns, stolen_ms=stolen_ms)

    @property
    def left_out(self) -> float:
        """Share of the ticks in which the machine did not keep its pace."""
        return float(1.0 - self.kept.mean())

    def just_before(self, stamp_ns: int) -> str:
        """The longest standstill shortly before `stamp_ns`, as the end of a message; empty if none was long."""
        ended = (self._stood[:, 1] > stamp_ns - _ns(_SOON_S)) & (self._stood[:, 0] < stamp_ns)
        longest = max(self._stood[ended].tolist(), key=lambda span: span[1] - span[0], default=[0, 0])
        stood_s, ago_s = 1e-9 * (longest[1] - longest[0]), 1e-9 * (stamp_ns - longest[1])
        if stood_s < _LONG_S:
            return ""
        return f", {max(ago_s, 0.0):.2f} s after the machine itself stood still for {1e3 * stood_s:.0f} ms"

    def off_pace(self, seconds: Float, after: Float | float = 0.0) -> Float:
        """How much of a time the machine stood still or was slow, (T,) [s]; arguments as of `apart`."""
        end = self._stamps + _ns(after)
        return 1e-9 * covered(end - _ns(seconds), end, self._spans)

    def apart(self, seconds: Float, after: Float | float = 0.0) -> Float:
        """The values of a time during which the machine kept its pace, (k,) [s].

        Args:
            seconds: the time that ended in each tick, (T,) [s]; NaN: none did.
            after: how much of it lies after the tick's wake, (T,) or one for all [s].
        """
        kept: Float = seconds[self.off_pace(seconds, after) <= _SHARE * np.nan_to_num(seconds)]
        return kept


def _share(spans: Int, begin: int, end: int) -> float:
    """Share of the time from `begin` to `end` that lies in a span."""
    return float(covered(np.array([begin]), np.array([end]), spans)[0]) / max(end - begin, 1)


def _between(spans: Int, first: int, last: int) -> Int:
    return spans[(spans[:, 1] > first) & (spans[:, 0] < last)]


def _ns(seconds: Float | float) -> Int:
    return np.asarray(np.nan_to_num(np.asarray(seconds) * 1e9), np.int64)
