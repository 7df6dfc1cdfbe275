"""`Lead`: how far ahead of the present a plan must join, so that it is made in time."""

from __future__ import annotations

from collections import deque
from enum import Enum
from typing import Protocol

import numpy as np


class Kind(Enum):
    """Kinds of plans, which take different times to make."""

    WHOLE = "follows the source as far as plans reach"
    PARTIAL = "follows a new target for a moment"
    STOP = "comes to a stop"


class Lead(Protocol):
    """Gives the distance to the join, from the times that plans took."""

    def ticks(self, kind: Kind) -> int:
        """Ticks from now to the join."""
        ...

    def record(self, kind: Kind, seconds: float) -> None:
        """A plan took this long [s]."""
        ...


class FixedLead:
    """The same for every plan: in lockstep planning takes no time."""

    def __init__(self, ticks: int) -> None:
        self._ticks = ticks

    def ticks(self, kind: Kind) -> int:
        """See `Lead.ticks`."""
        return self._ticks

    def record(self, kind: Kind, seconds: float) -> None:
        """See `Lead.record`."""


_REMEMBERED = 32
"""Plans of each kind whose times count."""
_SHARE = 95
"""Percentile of their times that a plan has; one in twenty comes late and is made again."""
_MARGIN = 1.15


class MeasuredLead:
    """A percentile of the times that the last plans of each kind took.

    Args:
        rate_hz: ticks a second.
        at_first: assumed time of each kind until plans were made [s].
        most_s: longest lead: further ahead the plan that plays would be over. Longer times are taken for delays of the
            machine and ignored [s].
    """

    def __init__(self, rate_hz: float, at_first: dict[Kind, float], most_s: float) -> None:
        self._rate, self._most_s = rate_hz, most_s
        self._took = {kind: deque([seconds], maxlen=_REMEMBERED) for kind, seconds in at_first.items()}

    def ticks(self, kind: Kind) -> int:
        """See `Lead.ticks`."""
        seconds = min(_MARGIN * float(np.percentile(self._took[kind], _SHARE)), self._most_s)
        # Counted from the next tick, which is half a period away on average: that adds to the margin.
        return max(int(np.ceil(seconds * self._rate)), 1)

    def record(self, kind: Kind, seconds: float) -> None:
        """See `Lead.record`."""
        if seconds < self._most_s:
            self._took[kind].append(seconds)
