"""`Lease`: which operator's targets the robot follows, and how another one takes over."""

from __future__ import annotations

from flexmotion.configs.stream import Gateway


class Lease:
    """One operator at a time. Whoever sends a target while nobody holds the lease takes it.

    A source with a higher priority takes it over with its first target, one with the same priority by asking for it
    (`take`), one with a lower priority not at all. Stops, `disarm` and `kill` need no lease.

    Args:
        settings: priorities, and how long the lease lasts without a message.

    Attributes:
        holder: the operator; None: nobody.
        takeovers: how often the lease went from one operator to another.
    """

    def __init__(self, settings: Gateway) -> None:
        self.settings = settings
        self.holder: str | None = None
        self.takeovers = 0
        self._heard_s = 0.0

    def lapse(self, now_s: float) -> None:
        """Free the lease where its holder has sent nothing for too long."""
        if self.holder is not None and now_s - self._heard_s > self.settings.lease_s:
            self.holder = None

    def refusal(self, source: str, now_s: float, *, take: bool = False) -> str | None:
        """Why a source may not send targets now; None where it may: then it holds the lease.

        Args:
            source: who sends.
            now_s: time, on one clock in all calls [s].
            take: the source asks for the lease.
        """
        self.lapse(now_s)
        if self.holder not in (None, source):
            own, other = self.settings.priority(source), self.settings.priority(self.holder)
            if own < other or (own == other and not take):
                free = f"it is free {self.settings.lease_s:g} s after the operator's last message"
                way = f"it can be taken over by 'take'; {free}" if own == other else f"its priority is higher; {free}"
                return f"{self.holder!r} is the operator; {way}"
            self.takeovers += 1
        self.holder, self._heard_s = source, now_s
        return None

    def release(self, source: str) -> bool:
        """Give the lease back; returns whether the source held it."""
        held = self.holder == source
        if held:
            self.holder = None
        return held
