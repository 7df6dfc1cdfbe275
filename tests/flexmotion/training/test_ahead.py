"""Batches are the same whoever draws them."""

from __future__ import annotations

import multiprocessing
import os
import signal
import subprocess
import sys
from dataclasses import dataclass

import numpy as np
import psutil
import pytest

torch = pytest.importorskip("torch", reason="training needs the extra 'train'")

from flexmotion.training.ahead import Ahead, _end_with  # noqa: E402

from ...waiting import wait_until  # noqa: E402


@dataclass(frozen=True)
class Batch:
    values: torch.Tensor
    numbers: np.ndarray
    drawn_by: int


def draw(step: int) -> Batch:
    rng = np.random.default_rng((5, step))
    return Batch(torch.from_numpy(rng.standard_normal((4, 3))), rng.integers(0, 9, 6), os.getpid())


@pytest.fixture
def ahead() -> Ahead[Batch]:
    """As for a GPU: workers draw on the CPU, whatever trains."""
    return Ahead(torch.device("cuda"), workers=2)


def test_other_processes_draw_what_this_one_would(ahead: Ahead[Batch]) -> None:
    for step in (0, 1, 2, 3, 9, 10, 4):  # in order, a jump ahead, and a step again after a resume
        found, expected = ahead(step, draw), draw(step)
        assert torch.equal(found.values, expected.values)
        np.testing.assert_array_equal(found.numbers, expected.numbers)
        assert found.drawn_by != os.getpid()


def test_a_cpu_draws_for_itself() -> None:
    assert Ahead(torch.device("cpu"))(3, draw).drawn_by == os.getpid()


def test_a_worker_that_fails_is_heard() -> None:
    def broken(step: int) -> Batch:
        raise ValueError(f"step {step}: no clip is long enough")

    with pytest.raises(ValueError, match="no clip is long enough"):
        Ahead(torch.device("cuda"), workers=1)(0, broken)


def test_closed_ones_leave_no_process_and_draw_again(ahead: Ahead[Batch]) -> None:
    """Three trainings one after the other left twelve processes."""
    worker = psutil.Process(ahead(0, draw).drawn_by)
    assert alive(worker)
    ahead.close()
    wait_until(lambda: not alive(worker), "the drawing process to end")
    assert torch.equal(ahead(1, draw).values, draw(1).values)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGHUP])
def test_signals_of_the_terminal_are_left_to_the_training(ahead: Ahead[Batch], number: int) -> None:
    """Ctrl-C ended the drawing processes first: the step that was to be saved failed."""
    before = ahead(0, draw).drawn_by, ahead(1, draw).drawn_by
    for worker in set(before):
        os.kill(worker, number)
    for step in range(2, 8):
        assert torch.equal(ahead(step, draw).values, draw(step).values)


def alive(process: psutil.Process) -> bool:
    """Whether it runs; one that has ended may wait for somebody to take note of it."""
    try:
        return bool(process.status() != psutil.STATUS_ZOMBIE)
    except psutil.NoSuchProcess:
        return False


BIG = 20_000
"""Numbers of a batch that does not fit into a pipe: its process waits until somebody reads it."""


def test_a_killed_training_leaves_no_process() -> None:
    """Processes that wait in a full pipe outlived a training that was killed."""
    program = (
        "import time, numpy, torch\n"
        "from flexmotion.training.ahead import Ahead\n"
        f"draw = lambda step: numpy.zeros({BIG})\n"
        "ahead = Ahead(torch.device('cuda'), workers=2); ahead(0, draw); print('drawn', flush=True); time.sleep(60)\n"
    )
    with subprocess.Popen([sys.executable, "-c", program], stdout=subprocess.PIPE, text=True) as training:
        assert training.stdout is not None and training.stdout.readline() == "drawn\n"
        workers = psutil.Process(training.pid).children()
        assert len(workers) >= 2
        training.kill()
    wait_until(lambda: not any(map(alive, workers)), "the drawing processes to end")


def test_a_training_that_was_killed_while_its_processes_began_leaves_none() -> None:
    """A process that began after its training was killed asked too late to be told, and waited in a full pipe."""
    parent = os.getpid()
    begun = multiprocessing.get_context("fork").Process(target=_end_with, args=(parent, 0))
    begun.start()
    begun.join()
    assert begun.exitcode == 0
    orphan = multiprocessing.get_context("fork").Process(target=_end_with, args=(psutil.Process(parent).ppid(), 0))
    orphan.start()
    orphan.join()
    assert orphan.exitcode == 1
