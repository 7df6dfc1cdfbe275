"""Runs in processes of their own, each with one thread for linear algebra."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from multiprocessing import active_children, get_context
from typing import TypeVar

from rich.console import Console
from rich.progress import Progress

Task = TypeVar("Task")
Found = TypeVar("Found")

ONE_THREAD = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
"""Environment of a process that is one thread; NumPy reads it when it is imported."""


def in_processes(
    function: Callable[[Task], Found], tasks: Sequence[Task], jobs: int, *, done: int = 0
) -> Iterator[tuple[int, Found]]:
    """Run a function over tasks, with a progress bar on stderr; yields a task's number and its result.

    Args:
        function: of a module, so that another process can import it.
        tasks: its arguments.
        jobs: processes at a time.
        done: tasks that were finished earlier, for the progress bar.

    Results come in any order.
    """
    # Spawned children read the environment before they import NumPy.
    os.environ |= ONE_THREAD
    with Progress(console=Console(stderr=True)) as progress, ProcessPoolExecutor(jobs, get_context("spawn")) as pool:
        bar = progress.add_task("runs", total=done + len(tasks), completed=done)
        running = {pool.submit(function, task): number for number, task in enumerate(tasks)}
        try:
            for future in as_completed(running):
                yield running[future], future.result()
                progress.advance(bar)
        except BaseException:
            # The pool would wait for all tasks: a benchmark that fails or is stopped ends now, and they with it.
            pool.shutdown(wait=False, cancel_futures=True)
            for process in active_children():
                process.terminate()
            raise


def in_order(function: Callable[[Task], Found], tasks: Sequence[Task], jobs: int) -> list[Found]:
    """Likewise; all results in the order of the tasks."""
    found = dict(in_processes(function, tasks, jobs))
    return [found[number] for number in range(len(tasks))]
