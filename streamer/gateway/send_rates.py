"""`SendRates`: when a target may go to the planner: an interval for each part of the body, a rate for all together."""

from __future__ import annotations

from collections import deque

from flexmotion.streamer.gateway.asked import WHOLE_BODY

_AT_ONCE = 2
"""Targets that may be sent together: the second of a pair does not wait, and the planner, whose priority is higher,
makes no plan for the first one before the gateway's process comes to the second."""
_PARTS_AT_ONCE, _PARTS_S = 32, 0.1
"""Targets for parts that are sent in so many seconds [s], whatever names they have: half of what the mailbox keeps, in
about the time that a plan takes."""
MOST_WAITING = 64
"""Parts for which a target may wait: more than a robot has."""


class SendRates:
    """What was sent lately, in memory that does not grow with names of parts.

    Args:
        coalesce_s: interval of coalescing of one part, or of the whole body [s].
    """

    def __init__(self, coalesce_s: float) -> None:
        self._between_s = _AT_ONCE * coalesce_s
        self._sent_s: dict[str, deque[float]] = {}  # by part, as long as it may delay the next one
        self._parts_sent_s: deque[float] = deque(maxlen=_PARTS_AT_ONCE)

    def may_send(self, part: str, now_s: float) -> bool:
        """Whether a target for a part may be sent now."""
        parts = self._parts_sent_s
        if part != WHOLE_BODY and len(parts) == _PARTS_AT_ONCE and now_s - parts[0] < _PARTS_S:
            return False
        sent = self._sent_s.get(part)
        return sent is None or len(sent) < _AT_ONCE or now_s - sent[0] >= self._between_s

    def sent(self, part: str, now_s: float) -> None:
        """A target for a part is sent."""
        self._sent_s = {key: sent for key, sent in self._sent_s.items() if now_s - sent[-1] < self._between_s}
        self._sent_s.setdefault(part, deque(maxlen=_AT_ONCE)).append(now_s)
        if part != WHOLE_BODY:
            self._parts_sent_s.append(now_s)
