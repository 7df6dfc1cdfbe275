"""`Workers`: processes that run tasks. An interrupt reaches the parent alone; a process that dies is replaced."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from multiprocessing import get_context
from types import TracebackType
from typing import Self, TypeVar

from flexmotion.worker_process import begin_worker, limit_threads

Task = TypeVar("Task")
Found = TypeVar("Found")


class Workers:
    """A pool of processes with one thread each.

    Args:
        count: of processes.
    """

    def __init__(self, count: int) -> None:
        self.count = count
        self._pool: ProcessPoolExecutor | None = None

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

        Args:
            function: of a module, so that another process can import it.
            died: the result of a task whose process dies with it.
            done: called after every task.
        """
        found: dict[int, Found] = {}
        try:
            pool = self._begun()
            running = {pool.submit(function, task): number for number, task in enumerate(tasks)}
            for future in as_completed(running):
                found[running[future]] = future.result()
                done()
        except BrokenProcessPool:
            # One task has killed its process, and with it all that ran: each of the rest by itself shows which.
            for number, task in enumerate(tasks):
                if number not in found:
                    found[number] = self._alone(function, task, died)
                    done()
        except BaseException:
            self._end()
            raise
        return [found[number] for number in range(len(tasks))]

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
            self._pool = ProcessPoolExecutor(self.count, get_context("spawn"), _begin)
            heard = threading.current_thread() is threading.main_thread()
            before = signal.signal(signal.SIGINT, signal.SIG_IGN) if heard else None
            try:
                started: list[Future[None]] = [self._pool.submit(_nothing) for _ in range(self.count)]
            finally:
                if heard:
                    signal.signal(signal.SIGINT, before)
            del started
        return self._pool

    def _end(self) -> None:
        if self._pool is not None:
            self._pool.shutdown(wait=True, cancel_futures=True)
            self._pool = None


def _begin() -> None:
    begin_worker()
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def _nothing() -> None:
    """Task that starts a process."""
