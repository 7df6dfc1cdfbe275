"""Why the robot does not do as it is told: the cause that the loop gave last."""

from __future__ import annotations

from flexmotion.streamer.control.telemetry import Event

_CHANGE = " -> "


def cause_after(event: Event, before: str | None) -> str | None:
    """The cause in force after an event of the loop; None: there is none.

    A change of the ladder's state tells its cause behind a colon, and ends an earlier one where it tells none.
    """
    if _CHANGE in event.message and event.kind in ("state", "fault"):
        return event.message.partition(": ")[2] or None
    return event.message if event.kind == "fault" else before
