"""Child processes that end with their parent, however the parent ends."""

from __future__ import annotations

import ctypes
import multiprocessing
import os
import signal
from collections.abc import Callable
from multiprocessing.process import BaseProcess
from typing import Any

_PR_SET_PDEATHSIG, _PR_SET_NAME = 1, 15
_FORK = multiprocessing.get_context("fork")
"""Forked, so that a child shares robot, source and memory without names or copies, and starts within milliseconds."""


def start(name: str, target: Callable[..., None], *args: Any, orphaned: signal.Signals = signal.SIGKILL) -> BaseProcess:
    """Start `target(*args)` in a child process that `ps` calls `fm-NAME`.

    A child has a process group of its own, so that signals of a terminal reach only the process that the user started.

    Args:
        orphaned: signal that the child receives if this process ends before it.
    """
    child = _FORK.Process(target=_run, args=(name, os.getpid(), orphaned, target, args), name=f"flexmotion-{name}")
    child.start()
    return child


def _run(name: str, parent: int, orphaned: signal.Signals, target: Callable[..., None], args: tuple[Any, ...]) -> None:
    os.setpgid(0, 0)
    for number in (signal.SIGINT, signal.SIGHUP, signal.SIGUSR1, signal.SIGUSR2):
        signal.signal(number, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    signal.set_wakeup_fd(-1)
    libc = ctypes.CDLL(None)
    libc.prctl(_PR_SET_NAME, f"fm-{name}".encode()[:15], 0, 0, 0)
    libc.prctl(_PR_SET_PDEATHSIG, int(orphaned), 0, 0, 0)
    if os.getppid() != parent:  # the parent ended before prctl
        os.kill(os.getpid(), orphaned)
    target(*args)


def end(child: BaseProcess, *, patience_s: float) -> None:
    """Wait for a child to end; kill it after `patience_s`."""
    child.join(patience_s)
    if child.is_alive():
        child.kill()
        child.join()


def cause(child: BaseProcess) -> str:
    """How a child ended: its signal or its exit code."""
    code = child.exitcode or 0
    return f"signal {-code}" if code < 0 else f"exit code {code}"
