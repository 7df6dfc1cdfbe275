"""Programs that a benchmark starts, which end with it: also where it fails or is stopped."""

from __future__ import annotations

import signal
import subprocess
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from types import FrameType
from typing import IO, Any

import psutil

ENDED_S = 120.0
"""Longest time until a program that is asked to end has ended [s]; a robot stands still and parks meanwhile."""


@contextmanager
def started(
    command: Sequence[str],
    *,
    stdin: int | None = None,
    stdout: int | IO[str] | None = None,
    stderr: int | IO[str] | None = None,
    text: bool = False,
) -> Iterator[subprocess.Popen[Any]]:
    """Context of a program; one that still runs at its end is asked to end, and waited for.

    It is asked by SIGTERM: what a shell runs in the background ignores SIGINT, and so do the programs that it starts.
    It has a process group of its own: a terminal's Ctrl-C reaches the benchmark alone. See `subprocess.Popen` for the
    arguments.
    """
    with subprocess.Popen(command, stdin=stdin, stdout=stdout, stderr=stderr, text=text, process_group=0) as process:
        try:
            yield process
        finally:
            if process.poll() is None:
                process.terminate()
                try:
                    process.wait(ENDED_S)
                except subprocess.TimeoutExpired:
                    # Programs that it started itself do not end with it.
                    for program in psutil.Process(process.pid).children(recursive=True):
                        with suppress(psutil.NoSuchProcess):
                            program.kill()
                    process.kill()


def end_on_terminate() -> None:
    """Let SIGTERM end this program as Ctrl-C does: contexts are left, so that no program that it started goes on."""

    def leave(number: int, _frame: FrameType | None) -> None:
        raise SystemExit(128 + number)

    signal.signal(signal.SIGTERM, leave)
