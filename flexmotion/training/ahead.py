"""`Ahead`: batches that other processes draw before they are needed, so that a GPU does not wait for them."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Generic, TypeVar

import torch
from torch.utils.data import DataLoader, Dataset

Batch = TypeVar("Batch")

WORKERS = 4
"""Processes that draw for one GPU."""

ENDLESS = 1 << 31


class Ahead(Generic[Batch]):
    """Batches by step.

    A batch depends on its step alone, so that a resumed training sees the same ones, whoever draws them.

    Args:
        draw: batch of a step, on the CPU.
        device: on which it is trained; on the CPU this process draws, for it would not wait.
        workers: processes that draw for a GPU.
    """

    def __init__(self, draw: Callable[[int], Batch], device: torch.device, workers: int = WORKERS) -> None:
        self._draw, self._workers = draw, workers if device.type == "cuda" else 0
        self._next = 0
        self._drawn: Iterator[Batch] | None = None

    def __call__(self, step: int) -> Batch:
        """Batch of a step; already drawn where steps are asked for in order."""
        if not self._workers:
            return self._draw(step)
        if self._drawn is None or step != self._next:
            steps = range(step, ENDLESS)
            # Forked, they share the memory of the features, and begin at once.
            self._drawn = iter(
                DataLoader(
                    _Steps(self._draw),
                    batch_size=None,
                    sampler=steps,
                    num_workers=self._workers,
                    collate_fn=_as_drawn,
                    multiprocessing_context="fork",
                )
            )
        self._next = step + 1
        return next(self._drawn)


class _Steps(Dataset[Batch]):
    """Batches as a data set: an item is the batch of a step."""

    def __init__(self, draw: Callable[[int], Batch]) -> None:
        self._draw = draw

    def __getitem__(self, step: int) -> Batch:
        return self._draw(step)


def _as_drawn(batch: Batch) -> Batch:
    return batch
