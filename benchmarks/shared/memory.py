"""`Memory`: memory of processes over time, and how fast it grows."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import psutil
from numpy.typing import NDArray
from scipy.stats import theilslopes

Float = NDArray[np.float64]

Sample = tuple[float, float, float]
"""Time [s], resident and private memory [MB]."""

SETTLED_S = 120.0
"""After this time every buffer of a run has its full size [s]."""
JUDGED_S = 300.0
"""A slope over less than this says nothing about ten minutes [s]."""
TEN_MINUTES_S = 600.0


def of_process(pid: int) -> tuple[float, float]:
    """Resident and private memory of a process [MB].

    Private is what it has written and nobody shares (`Anonymous` in `/proc/PID/smaps_rollup`): neither its libraries
    nor the rings that processes of a run share, whose pages count as resident once they are touched.

    Raises:
        FileNotFoundError, ProcessLookupError: it has ended.
    """
    known = dict(
        line.split(":", 1) for line in Path(f"/proc/{pid}/smaps_rollup").read_text().splitlines()[1:] if ":" in line
    )
    return tuple(int(known[name].split()[0]) * 1.024e-3 for name in ("Rss", "Anonymous"))  # type: ignore[return-value]


def of_family(pid: int) -> dict[str, tuple[float, float]]:
    """The same for a process and all below it, by their names in `ps`; those of one name together."""
    found: dict[str, tuple[float, float]] = {}
    for process in (psutil.Process(pid), *psutil.Process(pid).children(recursive=True)):
        try:
            name, (resident, private) = process.name(), of_process(process.pid)
        except (psutil.NoSuchProcess, FileNotFoundError, ProcessLookupError):
            continue
        before = found.get(name, (0.0, 0.0))
        found[name] = (before[0] + resident, before[1] + private)
    return found


@dataclass(frozen=True)
class Growth:
    """Growth of a process in ten minutes, by the median slope of all pairs of samples after the start (Theil and Sen).

    Attributes:
        resident_mb, private_mb: [MB].
        least_mb, most_mb: bounds of the private one, 95 % [MB].
        seconds: that it is measured over.
    """

    resident_mb: float
    private_mb: float
    least_mb: float
    most_mb: float
    seconds: float

    @property
    def judged(self) -> bool:
        """Whether it was measured for long enough."""
        return self.seconds >= JUDGED_S


def growth(samples: list[Sample]) -> Growth | None:
    """Growth by samples after `SETTLED_S`; None: fewer than ten."""
    known = np.array([one for one in samples if one[0] >= SETTLED_S]).reshape(-1, 3)
    if len(known) < 10:
        return None
    time_s, resident, private = known.T
    slope, _, least, most = theilslopes(private, time_s)
    return Growth(
        resident_mb=float(theilslopes(resident, time_s)[0] * TEN_MINUTES_S),
        private_mb=float(slope * TEN_MINUTES_S),
        least_mb=float(least * TEN_MINUTES_S),
        most_mb=float(most * TEN_MINUTES_S),
        seconds=float(time_s[-1] - time_s[0]),
    )
