"""`Hub`: the gateway's desk for transports whose libraries call from threads of their own."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Callable, Hashable
from contextlib import suppress
from typing import Protocol

from flexmotion.configs.stream import Gateway
from flexmotion.streamer.control.tick_row import TickRow
from flexmotion.streamer.gateway.asked import Reply
from flexmotion.streamer.gateway.desk import Desk
from flexmotion.streamer.gateway.status import Status
from flexmotion.streamer.gateway.ways import Way

_MOST_WAITING = 256
"""Messages that the desk has not looked at; a thread with a further one waits."""
_ENDED_S = 5.0
"""A desk that looks at nothing for this long has ended [s]."""


class Hub:
    """Made in the thread of the gateway's event loop; every method may be called from any other thread.

    Args:
        desk: of the gateway.
        status: makes the status of the run, in the desk's thread.
        wake: called after a message has come in.

    Attributes:
        settings: of the gateway.
    """

    def __init__(self, desk: Desk, status: Callable[[], Status], wake: Callable[[], None]) -> None:
        self.settings: Gateway = desk.settings
        self._desk, self._status, self._wake = desk, status, wake
        self._loop = asyncio.get_running_loop()
        self._room = threading.BoundedSemaphore(_MOST_WAITING)

    def receive(self, data: bytes, reply: Reply, sender: Hashable = None) -> None:
        """See `Desk.receive`; `reply` is called in the desk's thread and must not wait. Waits for room."""
        if self._room.acquire(timeout=_ENDED_S):
            self._call(lambda: self._take(data, reply, sender))

    def reject(self, why: str) -> None:
        """See `Desk.reject`."""
        self._call(lambda: self._desk.reject(why))

    def ask_status(self, reply: Callable[[Status], None]) -> None:
        """Have `reply` called with the status, in the desk's thread."""
        self._call(lambda: reply(self._status()))

    def row(self) -> TickRow | None:
        """The newest row of the loop; None before the first."""
        return self._desk.row()

    def _take(self, data: bytes, reply: Reply, sender: Hashable) -> None:
        self._room.release()
        self._desk.receive(data, reply, sender)
        self._wake()

    def _call(self, what: Callable[[], None]) -> None:
        with suppress(RuntimeError):  # the gateway has ended
            self._loop.call_soon_threadsafe(what)


class Transport(Protocol):
    """A way for messages to the desk beside HTTP and WebSocket.

    Attributes:
        name: what messages call it.
    """

    name: str

    def begin(self, hub: Hub, way: Way) -> Callable[[], None]:
        """Take messages from now on; returns what ends it. Runs in the gateway's process, and must not wait.

        Args:
            hub: of the gateway.
            way: is told whether messages can come.
        """
        ...
