"""`first_signal`: the first signal lets a long command save what it has; the second one ends it at once."""

from __future__ import annotations

import os
import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType

_NOTE = b"\nstops after this step and saves; signal again to end at once\n"


@contextmanager
def first_signal() -> Iterator[Callable[[], bool]]:
    """Context in which the first SIGINT, SIGTERM or SIGHUP (closed terminal) is only remembered.

    The second one does what it did before the context. To be used in the main thread.

    Yields:
        Function that says whether a signal has come.
    """
    # Under nohup a closed terminal is nothing.
    handled = [n for n in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP) if signal.getsignal(n) is not signal.SIG_IGN]
    before = {number: signal.getsignal(number) for number in handled}
    received: list[int] = []

    def restore() -> None:
        for number, handler in before.items():
            signal.signal(number, handler)

    def receive(number: int, _frame: FrameType | None) -> None:
        received.append(number)
        restore()
        # It may interrupt a print: a buffered stream must not be entered twice.
        os.write(2, _NOTE)

    for number in handled:
        signal.signal(number, receive)
    try:
        yield lambda: bool(received)
    finally:
        restore()
