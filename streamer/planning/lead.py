"""How far ahead of the present a plan must join, so that it is made in time."""

from __future__ import annotations

from collections import deque
from enum import Enum
from typing import Protocol

import numpy as np


class Kind(Enum):
    """Plans that take different times to make."""

    WHOLE = "follows the source as far as plans reach"
    PARTIAL = "follows a new target for a moment"
    STOP = "comes to a stop"


class Lead(Protocol):
    """Says how far ahead to join, and hears what plans took."""

    def ticks(self, kind: Kind) -> int:
        """Ticks from now to the join."""
        ...

    def took(self, kind: Kind, seconds: float) -> None:
        """A plan took this long [s]."""
        ...


class FixedLead:
    """The same for every plan: in lockstep planning takes no time."""

    def __init__(self, ticks: int) -> None:
        self._ticks = ticks

    def ticks(self, kind: Kind) -> int:
        """See `Lead.ticks`."""
        return self._ticks

    def took(self, kind: Kind, seconds: float) -> None:
        """See `Lead.took`."""


_REMEMBERED = 32
_SHARE = 95
"""Percentile of what the last plans took; the rest come late and are made again, one tick in twenty plans."""
_MARGIN = 1.15


class MeasuredLead:
    """What plans of a kind took lately.

    Args:
        at_first: what one takes [s], until more is known.
        most_s: no plan joins further ahead: the one that plays would be over. What took longer was held up [s].
    """

    def __init__(self, rate_hz: float, at_first: dict[Kind, float], most_s: float) -> None:
        self._rate, self._most_s = rate_hz, most_s
        self._took = {kind: deque([seconds], maxlen=_REMEMBERED) for kind, seconds in at_first.items()}

    def ticks(self, kind: Kind) -> int:
        """See `Lead.ticks`."""
        seconds = min(_MARGIN * float(np.percentile(self._took[kind], _SHARE)), self._most_s)
        # Counted from the tick that comes next, which on average is half a period away: that is the margin on top.
        return max(int(np.ceil(seconds * self._rate)), 1)

    def took(self, kind: Kind, seconds: float) -> None:
        """See `Lead.took`."""
        if seconds < self._most_s:
            self._took[kind].append(seconds)
