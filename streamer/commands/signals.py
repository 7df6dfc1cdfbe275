"""Signals as requests to a running robot, from the first moment of a command on."""

from __future__ import annotations

import signal
import socket
from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

import typer

from flexmotion.streamer.commands.exit_codes import INTERRUPTED, OK
from flexmotion.streamer.commands.output import print_note
from flexmotion.streamer.run.requests import Request


class _EndedEarlyError(BaseException):
    """The end was requested while a run was loaded; no `Exception`, which what is loaded may catch."""


class OperatorSignals:
    """Signals of an operator as requests.

    The first SIGINT, SIGTERM or SIGHUP (closed terminal) requests a stop, parking and the end; a second one the end at
    once. SIGUSR1 requests a stop, SIGUSR2 an emergency stop.

    Attributes:
        loading: nothing is started yet: a signal that requests the end leaves the context at once.
        interrupted: whether the end was requested.
        terminated: whether SIGTERM requested it, as a service manager does.
        wake: file descriptor that becomes readable with every signal.
    """

    def __init__(self, wake: int, *, loading: bool = False) -> None:
        self.wake, self.loading = wake, loading
        self.interrupted = self.terminated = False
        self._received: deque[int] = deque()

    def receive(self, number: int, _frame: FrameType | None) -> None:
        """Signal handler: it may interrupt anything, so it only stores the number, or ends what is loaded."""
        if self.loading and number not in (signal.SIGUSR1, signal.SIGUSR2):
            self.loading, self.interrupted, self.terminated = False, True, number == signal.SIGTERM
            raise _EndedEarlyError
        self._received.append(number)

    def next(self) -> Request | None:
        """The request of the oldest signal that was not taken yet; None if there is none."""
        if not self._received:
            return None
        number = self._received.popleft()
        if number == signal.SIGUSR1:
            return Request.STOP
        if number == signal.SIGUSR2:
            return Request.ESTOP
        if self.interrupted:
            return Request.QUIT
        self.interrupted, self.terminated = True, number == signal.SIGTERM
        print_note("stopping: the robot comes to a stand and parks; signal again to end at once")
        return Request.END


@contextmanager
def operator_signals(*, loading: bool = False) -> Iterator[OperatorSignals]:
    """Context in which signals are requests instead of ending the program.

    Args:
        loading: of the result, until it is cleared.

    Raises:
        typer.Exit: the end was requested while it was loading; 0 by SIGTERM, the regular end of a daemon.
    """
    reader, writer = socket.socketpair()
    with reader, writer:
        for end in (reader, writer):
            end.setblocking(False)
        signals = OperatorSignals(reader.fileno(), loading=loading)
        numbers = [signal.SIGINT, signal.SIGTERM, signal.SIGUSR1, signal.SIGUSR2]
        if signal.getsignal(signal.SIGHUP) is not signal.SIG_IGN:  # under nohup the run goes on
            numbers.append(signal.SIGHUP)
        before = {number: signal.signal(number, signals.receive) for number in numbers}
        woken = signal.set_wakeup_fd(writer.fileno(), warn_on_full_buffer=False)
        try:
            yield signals
        except _EndedEarlyError:
            print_note("interrupted while the run was loaded: nothing was started")
            raise typer.Exit(OK if signals.terminated else INTERRUPTED) from None
        finally:
            signal.set_wakeup_fd(woken)
            for number, handler in before.items():
                signal.signal(number, handler)
