"""`Way`: whether one way to a run works, such as stops over a gamepad; and a thread that is started again if it fails.

A thread that carries stops must not end unseen. What fails is an event of the run (log, page, report), stands in the
status and makes `GET /health` fail, until it works again.
"""

from __future__ import annotations

import asyncio
import logging
import math
import threading
import time
from collections.abc import Callable, Iterable
from typing import Any

import numpy as np

from flexmotion.drivers.realtime.ring import Ring
from flexmotion.records import Record, column
from flexmotion.streamer.run.requests import Request, RequestChannel

AGAIN_S = 1.0
"""Time until what has failed is started again [s]."""
_APART_S = 0.2
"""Least time between two events about one way [s]."""
_REASON_BYTES = 240

log = logging.getLogger(__name__)


class _WayRow(Record):
    reason: Any = column(f"S{_REASON_BYTES}")
    """Why it does not work; empty: it does."""


class Way:
    """One way to a run. Made before the processes are forked; one of them tells, from any thread, and all may read.

    Args:
        name: what it carries and over what, such as "stops over zenoh".
        requests: channel to the loop of the process that tells.
    """

    def __init__(self, name: str, requests: RequestChannel) -> None:
        self.name, self._requests = name, requests
        self._ring = Ring(_WayRow.dtype(), 8)
        self._row = _WayRow(np.zeros((), _WayRow.dtype()))
        self._lock = threading.Lock()
        self._told, self._told_s = "", -math.inf

    @property
    def problem(self) -> str | None:
        """Why it does not work; None while it does."""
        row = self._ring.latest()
        return None if row is None else _WayRow(row).reason.item().decode(errors="replace") or None

    def works(self) -> None:
        """It works, or works again."""
        if self._told:
            self._tell("")

    def fails(self, reason: str) -> None:
        """It does not work; told once for each reason."""
        if reason != self._told:
            self._tell(reason)

    def _tell(self, reason: str) -> None:
        with self._lock:
            self._told = reason
            self._row.reason[...] = reason.encode()[:_REASON_BYTES]
            self._ring.publish(np.asarray(self._row.array))
            now_s = time.monotonic()
            if now_s - self._told_s < _APART_S:
                return  # one that comes and goes pushes no stop out of the channel
            self._told_s = now_s
        text = f"{self.name}: {reason or 'works again'}"
        log.warning("%s", text)
        self._requests.send(Request.WARNING if reason else Request.NOTE, text)

    def failed(self, error: BaseException) -> None:
        """It does not work for an error that nobody expected, whose traceback is logged."""
        log.error("%s", self.name, exc_info=error)
        self.fails(f"failed ({type(error).__name__}: {error}) and is started again")

    def keep(self, work: Callable[[], None], ended: threading.Event, name: str) -> threading.Thread:
        """Do something in a thread of its own until it comes back; if it fails, again and again.

        Args:
            work: calls `works` once it does.
            ended: set when nothing is to be started any more.
            name: of the thread.
        """

        def run() -> None:
            while not ended.is_set():
                try:
                    return work()
                except BaseException as error:  # also what a library raises that is no Exception
                    if not ended.is_set():
                        self.failed(error)
                ended.wait(AGAIN_S)

        thread = threading.Thread(target=run, name=name, daemon=True)
        thread.start()
        return thread

    def guarded(self, take: Callable[[Any], None]) -> Callable[[Any], None]:
        """A function for a library's own thread: an error ends neither that thread nor the next call."""

        def call(item: Any) -> None:
            try:
                take(item)
            except Exception as error:
                self.failed(error)
            else:
                self.works()

        return call


async def began(begin: Callable[[], Callable[[], None]], way: Way) -> Callable[[], None]:
    """Start a transport, and again until that works; returns what ends it.

    Args:
        begin: starts it; must not wait. The errors of its library do not affect other transports.
        way: is told what fails.
    """
    while True:
        try:
            return begin()
        except Exception as error:
            way.failed(error)
        await asyncio.sleep(AGAIN_S)


async def ended(tasks: Iterable[asyncio.Task[Callable[[], None]]]) -> None:
    """End the transports that `began` has started in these tasks."""
    for task in tasks:
        if task.done() and not task.cancelled():
            task.result()()
        else:
            task.cancel()
