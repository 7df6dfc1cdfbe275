"""`Presses`: STOP and emergency stop on their way from the stop process to the loop."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol

from flexmotion.streamer.control.telemetry import Telemetry, events
from flexmotion.streamer.gateway.ways import Way
from flexmotion.streamer.run.requests import Request, RequestChannel

LOOK_S = 0.001
"""Time between two looks whether the loop has taken a request [s]."""
_TAKEN_S = 1.0
"""A loop that has not taken a request after this time does not run [s]."""
_MOST_REPLIES = 1000
"""In a flood of stops, this many are answered within a period of the loop."""

log = logging.getLogger(__name__)


@dataclass(eq=False)
class Press:
    """A request on its way.

    Attributes:
        asked: STOP or ESTOP.
        arrived_tick: newest tick of the loop when it arrived; -1: none yet.
        told: its answer; None: not yet.
    """

    asked: Request
    arrived_tick: int
    due_s: float
    told: dict[str, Any] | None = None


class Presses:
    """Sends requests from any thread. Equal ones that the loop has not taken yet are sent once.

    Args:
        telemetry: of the loop.
        requests: the stop process's channel to the loop.
    """

    def __init__(self, telemetry: Telemetry, requests: RequestChannel) -> None:
        self.requests = requests
        self._ticks, self._seen = telemetry.ticks, telemetry.events.reader(new_only=True)
        self._open: dict[str, Press] = {}
        self._replies: list[tuple[Press, Callable[[dict[str, Any]], None]]] = []
        self._lock, self._waiting = threading.Lock(), threading.Event()
        self._thread: threading.Thread | None = None

    def press(self, asked: Request, by: str, reply: Callable[[dict[str, Any]], None] | None = None) -> Press:
        """Send a request.

        Args:
            asked: STOP or ESTOP.
            by: where it came from, for the log.
            reply: takes the answer, in a thread of its own; None: the caller calls `look` until there is one.
        """
        with self._lock:
            self._look()
            press = self._open.get(asked.name)
            if press is None:
                newest = self._ticks.latest()
                tick = -1 if newest is None else int(newest["tick"])
                press = self._open[asked.name] = Press(asked, tick, time.monotonic() + _TAKEN_S)
                self.requests.send(asked, by)
            if reply is not None and len(self._replies) < _MOST_REPLIES:
                self._replies.append((press, reply))
                if self._thread is None:
                    self._thread = threading.Thread(target=self._reply, name="presses", daemon=True)
                    self._thread.start()
                self._waiting.set()
        return press

    def look(self) -> None:
        """Answer what the loop has taken, or has not taken in time."""
        with self._lock:
            self._look()

    def _look(self) -> None:
        try:
            new = events(self._seen)
        except Exception:  # the next stop is sent, whatever becomes of the answer to this one
            log.exception("what the loop has taken cannot be read")
            new = []
        for event in new:
            press = self._open.get(event.message) if event.kind == "request" else None
            if press is not None:
                press.told = told(press.asked, "accepted", arrived_tick=press.arrived_tick, tick=event.tick)
        for press in self._open.values():
            if press.told is None and press.due_s < time.monotonic():
                reason = f"the loop did not take it within {_TAKEN_S:g} s"
                press.told = told(press.asked, "refused", arrived_tick=press.arrived_tick, reason=reason)
        self._open = {name: press for name, press in self._open.items() if press.told is None}

    def _reply(self) -> None:
        while True:
            self._waiting.wait()
            with self._lock:
                self._look()
                done = [one for one in self._replies if one[0].told is not None]
                self._replies = [one for one in self._replies if one[0].told is None]
                if not self._replies:
                    self._waiting.clear()
            for press, reply in done:
                assert press.told is not None
                try:
                    reply(press.told)
                except Exception:  # of a transport's library; others wait for their answers
                    log.exception("the answer to a stop was not delivered")
            time.sleep(LOOK_S)


def told(asked: Request | None, state: str, **known: Any) -> dict[str, Any]:
    """An answer of the stop process, as JSON content."""
    return {"type": "answer", "version": 1, "asked": asked.name.lower() if asked else None, "state": state, **known}


class StopInput(Protocol):
    """A way to the stop process beside its port, such as zenoh or a gamepad.

    Attributes:
        name: what messages call it.
    """

    name: str

    def begin(self, presses: Presses, way: Way) -> Callable[[], None]:
        """Take stops from now on; returns what ends it. Runs in the stop process, and must not wait.

        Args:
            presses: of the stop process.
            way: is told whether stops can come.
        """
        ...
