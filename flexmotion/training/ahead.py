"""`Ahead`: batches that other processes draw before they are needed, so that a GPU does not wait for them."""

from __future__ import annotations

import ctypes
import os
import signal
import sys
from collections.abc import Callable, Iterator
from functools import partial
from typing import Generic, TypeVar

import torch
from torch.utils.data import DataLoader, Dataset

Batch = TypeVar("Batch")

WORKERS = 4
"""Processes that draw for one GPU, at most as many as there are other cores. Each keeps a batch ready and draws the
next: of 768 windows with constraints a batch takes 170 MB of shared memory."""

ENDLESS = 1 << 31
"""More steps than any training has."""

_SIGNALS = {signal.SIGINT: signal.SIG_IGN, signal.SIGHUP: signal.SIG_IGN, signal.SIGTERM: signal.SIG_DFL}
"""What signals do in those processes, which were forked with the handlers of their parent."""

_PR_SET_PDEATHSIG = 1


class Ahead(Generic[Batch]):
    """Batches by step.

    A batch depends on its step alone, so that a resumed training sees the same ones, whoever draws them.

    Args:
        device: on which it is trained; on the CPU this process draws, for it would not wait.
        workers: processes that draw for a GPU.
    """

    def __init__(self, device: torch.device, workers: int | None = None) -> None:
        most = max(1, min(WORKERS, len(os.sched_getaffinity(0)) - 1)) if workers is None else workers
        self._workers = most if device.type == "cuda" else 0
        self._next = 0
        self._drawn: Iterator[Batch] | None = None

    def __call__(self, step: int, draw: Callable[[int], Batch]) -> Batch:
        """Batch of a step; already drawn where steps are asked for in order.

        Args:
            step: of the training.
            draw: batch of a step, on the CPU; the same in every call.
        """
        if not self._workers:
            return draw(step)
        if self._drawn is None or step != self._next:
            self.close()
            # Forked, they share the memory of the features, and begin at once.
            self._drawn = iter(
                DataLoader(
                    _Steps(draw),
                    batch_size=None,
                    sampler=range(step, ENDLESS),
                    num_workers=self._workers,
                    prefetch_factor=1,
                    collate_fn=_as_drawn,
                    worker_init_fn=partial(_end_with, os.getpid()),
                    multiprocessing_context="fork",
                )
            )
        self._next = step + 1
        return next(self._drawn)

    def close(self) -> None:
        """End the other processes; they begin anew where a batch is asked for."""
        ended, self._drawn = self._drawn, None
        if ended is not None:
            # Its finaliser does it too, but not while a traceback holds the iterator.
            ended._shutdown_workers()  # type: ignore[attr-defined]


class _Steps(Dataset[Batch]):
    """Batches as a data set: an item is the batch of a step."""

    def __init__(self, draw: Callable[[int], Batch]) -> None:
        self._draw = draw

    def __getitem__(self, step: int) -> Batch:
        return self._draw(step)


def _as_drawn(batch: Batch) -> Batch:
    return batch


def _end_with(parent: int, worker: int) -> None:
    """End when the parent ends, not before: a batch that waits in a full pipe would keep the process alive.

    A terminal sends its signals to all processes; the parent needs a batch more to end its step and to save.
    """
    for number, handler in _SIGNALS.items():
        signal.signal(number, handler)
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
    if os.getppid() != parent:  # killed before the line above, which tells of a later end only
        os._exit(1)
