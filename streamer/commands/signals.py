"""Signals as requests to a running robot, from the first moment of a command on."""

from __future__ import annotations

import signal
import socket
from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

from flexmotion.streamer.commands.output import print_note
from flexmotion.streamer.run.requests import Request


class OperatorSignals:
    """What signals ask for.

    The first SIGINT, SIGTERM or SIGHUP (a terminal that is closed) asks for a stop, parking and the end, a second one
    for the end at once; SIGUSR1 for a stop, SIGUSR2 for an emergency stop.

    Attributes:
        interrupted: whether the end was asked for.
        wake: file descriptor that becomes readable with every signal.
    """

    def __init__(self, wake: int) -> None:
        self.wake = wake
        self.interrupted = False
        self._heard: deque[int] = deque()

    def hear(self, number: int, _frame: FrameType | None) -> None:
        """Signal handler: it may interrupt anything, so it only remembers."""
        self._heard.append(number)

    def next(self) -> Request | None:
        """What the oldest signal not taken yet asks for."""
        if not self._heard:
            return None
        number = self._heard.popleft()
        if number == signal.SIGUSR1:
            return Request.STOP
        if number == signal.SIGUSR2:
            return Request.ESTOP
        if self.interrupted:
            return Request.QUIT
        self.interrupted = True
        print_note("stopping: the robot comes to a stand and parks; once more to cut this short")
        return Request.END


@contextmanager
def operator_signals() -> Iterator[OperatorSignals]:
    """Within, signals are requests."""
    ears, mouth = socket.socketpair()
    with ears, mouth:
        for end in (ears, mouth):
            end.setblocking(False)
        signals = OperatorSignals(ears.fileno())
        numbers = [signal.SIGINT, signal.SIGTERM, signal.SIGUSR1, signal.SIGUSR2]
        if signal.getsignal(signal.SIGHUP) is not signal.SIG_IGN:  # nohup: it is to go on
            numbers.append(signal.SIGHUP)
        before = {number: signal.signal(number, signals.hear) for number in numbers}
        woken = signal.set_wakeup_fd(mouth.fileno(), warn_on_full_buffer=False)
        try:
            yield signals
        finally:
            signal.set_wakeup_fd(woken)
            for number, handler in before.items():
                signal.signal(number, handler)
