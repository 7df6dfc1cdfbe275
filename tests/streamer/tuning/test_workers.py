"""Processes that run trials: results in order, and a task that kills its process costs only itself."""

from __future__ import annotations

import os
import signal
import tempfile
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

from flexmotion.streamer.tuning.workers import Workers


def root(task: int) -> float:
    if task < 0:
        os._exit(3)
    return task**0.5


def interrupted(task: int) -> int:
    """A terminal's Ctrl-C, which every process of the command gets."""
    os.kill(os.getpid(), signal.SIGINT)
    return task


def told(task: int) -> float:
    return -1.0


def test_results_come_in_the_order_of_the_tasks_and_a_dead_process_is_replaced() -> None:
    counted: list[None] = []
    with Workers(2) as workers:
        assert workers.run(root, [4, 9, 16], told) == [2.0, 3.0, 4.0]
        assert workers.run(root, [4, -1, 9], told, lambda: counted.append(None)) == [2.0, -1.0, 3.0]
        assert len(counted) == 3
        assert workers.run(root, [25], told) == [5.0]


def test_an_interrupt_does_not_end_a_worker() -> None:
    with Workers(1) as workers:
        assert workers.run(interrupted, [1, 2], lambda task: -1) == [1, 2]


def fails(task: int) -> float:
    raise ValueError(f"task {task}")


def test_an_error_of_the_function_comes_through() -> None:
    with Workers(1) as workers, pytest.raises(ValueError, match="task 7"):
        workers.run(fails, [7], told)


def interrupts_the_parent(task: int) -> int:
    os.kill(os.getppid(), signal.SIGINT)
    tempfile.mkdtemp()
    threading.Event().wait()  # for ever
    return task


@pytest.fixture
def hears_interrupts() -> Iterator[None]:
    """SIGINT as in a terminal; in a background job of a script it is ignored, and the test would hang."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.mark.usefixtures("hears_interrupts")
def test_an_interrupt_of_the_parent_ends_all_runs_and_leaves_no_files(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """The runs would never end by themselves, nor would the tasks that wait for a process."""
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    with Workers(1) as workers:
        with pytest.raises(KeyboardInterrupt):
            workers.run(interrupts_the_parent, [1, 2, 3], lambda task: -1)
        assert list(tmp_path.iterdir()) == []
        assert workers.run(root, [4], told) == [2.0]
    assert list(tmp_path.iterdir()) == []
