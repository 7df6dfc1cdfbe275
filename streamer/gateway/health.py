"""`Health`: whether a run can be reached, and stopped, over every way that it has."""

from __future__ import annotations

from collections.abc import Sequence

from flexmotion.streamer.gateway.ways import Way
from flexmotion.streamer.run.planner_process import Heartbeat

WORKS = "works"
STOPS = "stop process"
_SILENT_S = 5.0
"""A stop process without a sign of life for this long is reported [s]."""


class Health:
    """Reads what the processes of a run tell; may be used by any of them.

    Args:
        ways: to the run.
        alive: sign of life of the stop process; None: the run has none.
    """

    def __init__(self, ways: Sequence[Way] = (), alive: Heartbeat | None = None) -> None:
        self.ways, self.alive = tuple(ways), alive

    def problems(self) -> dict[str, str]:
        """Of each way, by its name: "works", or why it does not."""
        found = {way.name: way.problem or WORKS for way in self.ways}
        if self.alive is not None:
            age_s = self.alive.age_s
            silent = age_s is None or age_s > _SILENT_S
            since = "" if age_s is None else f" for {age_s:.0f} s"
            found[STOPS] = f"no sign of life{since}: signals and the gateway still stop the robot" if silent else WORKS
        return found
