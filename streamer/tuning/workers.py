"""`Workers`: processes that run tasks. An interrupt reaches the parent alone; a process that dies is replaced."""

from __future__ import annotations

import logging
import os
import signal
import tempfile
import threading
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from multiprocessing import get_context
from multiprocessing.synchronize import Event
from types import TracebackType
from typing import Self, TypeVar

from flexmotion.worker_process import begin_worker, limit_threads

Task = TypeVar("Task")
Found = TypeVar("Found")


class Workers:
    """A pool of processes with one thread each. Its end removes what they have left in their temporary folder.

    Args:
        count: of processes.
    """

    def __init__(self, count: int) -> None:
        self.count = count
        self._pool: ProcessPoolExecutor | None = None
        self._stopped: Event | None = None
        self._folder: tempfile.TemporaryDirectory[str] | None = None

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._end()

    def run(
        self,
        function: Callable[[Task], Found],
        tasks: Sequence[Task],
        died: Callable[[Task], Found],
        done: Callable[[], None] = lambda: None,
    ) -> list[Found]:
        """Run a function over tasks; results in the order of the tasks.

        An error, or an interrupt of this process, ends all runs at once.

        Args:
            function: of a module, so that another process can import it.
            died: the result of a task whose process dies with it.
            done: called after every task.
        """
        found: dict[int, Found] = {}
        try:
            try:
                self._together(function, tasks, found, done)
            except BrokenProcessPool:
                # One task has killed its process, and with it all that ran: each of the rest by itself shows which.
                for number, task in enumerate(tasks):
                    if number not in found:
                        found[number] = self._alone(function, task, died)
                        done()
        except BaseException:
            if self._stopped is not None:
                self._stopped.set()
            self._end()
            raise
        return [found[number] for number in range(len(tasks))]

    def _together(
        self,
        function: Callable[[Task], Found],
        tasks: Sequence[Task],
        found: dict[int, Found],
        done: Callable[[], None],
    ) -> None:
        pool = self._begun()
        running = {pool.submit(function, task): number for number, task in enumerate(tasks)}
        for future in as_completed(running):
            found[running[future]] = future.result()
            done()

    def _alone(self, function: Callable[[Task], Found], task: Task, died: Callable[[Task], Found]) -> Found:
        self._end()
        try:
            return self._begun().submit(function, task).result()
        except BrokenProcessPool:
            self._end()
            return died(task)

    def _begun(self) -> ProcessPoolExecutor:
        """The pool, whose processes ignore interrupts from their start on."""
        if self._pool is None:
            limit_threads()
            context = get_context("spawn")
            self._stopped, self._folder = context.Event(), tempfile.TemporaryDirectory()
            self._pool = ProcessPoolExecutor(self.count, context, _begin, (self._stopped, self._folder.name))
            heard = threading.current_thread() is threading.main_thread()
            before = signal.signal(signal.SIGINT, signal.SIG_IGN) if heard else None
            try:
                for _ in range(self.count):
                    self._pool.submit(_nothing)
            finally:
                if heard:
                    signal.signal(signal.SIGINT, before)
        return self._pool

    def _end(self) -> None:
        if self._pool is not None:
            self._pool.shutdown(wait=True, cancel_futures=True)
            self._pool = None
        if self._folder is not None:
            self._folder.cleanup()
            self._folder = None


def _begin(stopped: Event, folder: str) -> None:
    begin_worker()
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    logging.disable(logging.WARNING)  # notes on how a file is read would come with every run
    tempfile.tempdir = folder
    threading.Thread(target=_end_when, args=(stopped,), daemon=True).start()


def _end_when(stopped: Event) -> None:
    stopped.wait()
    os._exit(1)


def _nothing() -> None:
    """Task that starts a process."""
