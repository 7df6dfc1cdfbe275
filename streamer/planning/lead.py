"""`Lead`: how far ahead of the present a plan must join, so that it is made in time."""

from __future__ import annotations

import math
from collections import deque
from enum import Enum
from typing import Protocol

import numpy as np

from flexmotion.streamer.control.plan_intake import LATEST


class Kind(Enum):
    """Kinds of plans, which take different times to make."""

    WHOLE = "follows the source as far as plans reach"
    PARTIAL = "follows a new target for a moment"
    STOP = "comes to a stop"


class Lead(Protocol):
    """Gives the tick at which a plan can join, from the times that plans took."""

    def join(self, kind: Kind, now: float, spent_s: float | None = None, *, soon: bool = False) -> int:
        """First tick by whose beginning a plan of this kind will be ready.

        Args:
            now: the present, or the moment at which the plan was begun if `spent_s` is given [ticks].
            spent_s: the human motion is sampled, which took so long [s]; None: not yet.
            soon: a whole plan counts as one for a target: the next follows at once where the loop cannot take it.
        """
        ...

    def record(self, kind: Kind, sampling_s: float, rest_s: float) -> None:
        """A plan took this long until its human motion was sampled, and after that [s]."""
        ...


class FixedLead:
    """The same for every plan: in lockstep planning takes no time."""

    def __init__(self, ticks: int) -> None:
        self._ticks = ticks

    def join(self, kind: Kind, now: float, spent_s: float | None = None, *, soon: bool = False) -> int:
        """See `Lead.join`."""
        return math.ceil(now) + self._ticks

    def record(self, kind: Kind, sampling_s: float, rest_s: float) -> None:
        """See `Lead.record`."""


_REMEMBERED = 32
"""Plans of each kind whose times count."""
_SHARE = 95
"""Percentile of their times that a plan has after its motion is sampled; one in twenty would come late without the
margin."""
_MARGIN = 1.15
_SOONEST = 10
"""Percentile of the times before which no plan joins: nothing is gained where hardly any is ready."""


class MeasuredLead:
    """The times that the last plans of each kind took.

    A plan joins as early as a high percentile of the times after sampling permits; that of a target, a stop or a person
    who is mirrored `LATEST` ticks earlier, by which the loop still takes it late, but not before a low percentile,
    where nothing would be ready. Sampling is counted by its median first, and by what it took once it is done: slow
    sampling, or words that were read for the first time, put a plan off, and do not make it late.

    Args:
        rate_hz: ticks a second.
        at_first: assumed time of each kind until one was made [s].
        most_s: longest lead: further ahead the plan that plays would be over. Longer times are taken for delays of the
            machine and ignored [s].
    """

    def __init__(self, rate_hz: float, at_first: dict[Kind, float], most_s: float) -> None:
        self._rate, self._most_s, self._at_first = rate_hz, most_s, dict(at_first)
        self._sampling: dict[Kind, deque[float]] = {kind: deque(maxlen=_REMEMBERED) for kind in at_first}
        self._rest: dict[Kind, deque[float]] = {kind: deque(maxlen=_REMEMBERED) for kind in at_first}

    def join(self, kind: Kind, now: float, spent_s: float | None = None, *, soon: bool = False) -> int:
        """See `Lead.join`."""
        rest = self._rest[kind] or (self._at_first[kind],)
        rest_s = _MARGIN * float(np.percentile(rest, _SHARE))
        if soon or kind is not Kind.WHOLE:
            rest_s = max(rest_s - LATEST / self._rate, float(np.percentile(rest, _SOONEST)))
        if spent_s is None:
            sampling = self._sampling[kind]
            spent_s = float(np.median(sampling)) if sampling else 0.0
        return math.ceil(now + min(spent_s + rest_s, self._most_s) * self._rate)

    def record(self, kind: Kind, sampling_s: float, rest_s: float) -> None:
        """See `Lead.record`."""
        if sampling_s + rest_s < self._most_s:
            self._sampling[kind].append(sampling_s)
            self._rest[kind].append(rest_s)
