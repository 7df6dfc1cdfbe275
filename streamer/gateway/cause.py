"""`Cause`: why the robot does not do as it is told, from the loop's events."""

from __future__ import annotations

from flexmotion.streamer.control.telemetry import Event

_CHANGE, _STAND = " -> ", " -> HOLD"


class Cause:
    """The first cause, which changes of the ladder's state tell behind a colon, and the newest fault beside it.

    The first cause is the one to solve, and stays until a change of state tells none. Faults that change no state, such
    as torque off that is not confirmed or a planner that has died, are its consequences or of their own: they are told
    behind it until the next change of state. The stand that a robot without a planner comes to does not end them.
    """

    def __init__(self) -> None:
        self._first: str | None = None
        self._other: str | None = None

    @property
    def text(self) -> str | None:
        """Both; None: there is none."""
        return "; ".join(filter(None, (self._first, self._other))) or None

    def take(self, event: Event) -> None:
        """Take an event of the loop."""
        if _CHANGE in event.message and event.kind in ("state", "fault"):
            change, _, cause = event.message.partition(": ")
            self._first = cause or None
            if not change.endswith(_STAND):
                self._other = None
        elif event.kind == "fault":
            self._other = event.message
