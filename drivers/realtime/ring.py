"""`Ring`: rows of a fixed size in memory shared by forked processes: one writer, any number of readers, no waiting.

The memory has no name: the system frees it when the last process that maps it ends, however that process ends.
"""

from __future__ import annotations

import mmap
import threading
from typing import Any

import numpy as np
from numpy.typing import NDArray

Rows = NDArray[Any]

_HEADER_BYTES = 64
_barrier = threading.Lock()


def fence() -> None:
    """Order memory accesses before and after this call, on processors that would reorder them (Arm).

    Accesses before the call cannot move past the first release, accesses after it cannot move ahead of the second
    acquire, and operations on a lock keep their order.
    """
    for _ in range(2):
        _barrier.acquire()
        _barrier.release()


def shared_array(shape: int | tuple[int, ...], dtype: np.dtype[Any] | type) -> Rows:
    """An array of zeros, shared with processes that are forked from this one."""
    kind = np.dtype(dtype)
    count = int(np.prod(shape, dtype=np.int64))
    memory = mmap.mmap(-1, max(count * kind.itemsize, 1))
    return np.frombuffer(memory, kind, count).reshape(shape)


def touch(array: Rows) -> None:
    """Read every page of a shared array, so that this process has no page fault in it later."""
    array.view(np.uint8).reshape(-1)[:: mmap.PAGESIZE].max(initial=0)


class Ring:
    """The newest `capacity` rows of one writer.

    Create it before the processes that share it are forked.

    Args:
        dtype: of a row (structured).
        capacity: rows kept.
    """

    def __init__(self, dtype: np.dtype[Any], capacity: int) -> None:
        self.dtype, self.capacity = dtype, capacity
        self._count = shared_array(_HEADER_BYTES // 8, np.int64)
        self._rows = shared_array(capacity, dtype)

    @property
    def count(self) -> int:
        """Rows published so far."""
        return int(self._count[0])

    def publish(self, row: Rows) -> None:
        """Append one row, shape (); only one process may do so."""
        count = self.count
        self._rows[count % self.capacity] = row
        fence()
        self._count[0] = count + 1

    def latest(self) -> Rows | None:
        """A copy of the newest row, shape (); None before the first."""
        count = self.count
        if not count:
            return None
        # The copy is only torn if the writer writes the whole ring during it.
        fence()
        return self._rows[(count - 1) % self.capacity].copy()

    def touch(self) -> None:
        """See `touch`."""
        touch(self._rows)

    def reader(self, *, new_only: bool = False) -> Reader:
        """A reader that begins with the oldest row still kept, or with the next row published (`new_only`)."""
        return Reader(self, self.count if new_only else 0)


class Reader:
    """Reads the rows of a ring in order.

    Attributes:
        lost: rows that were overwritten before they were read.
    """

    def __init__(self, ring: Ring, first: int = 0) -> None:
        """`first` is the number of the first row to read."""
        self.ring = ring
        self.lost = 0
        self._next = first

    @property
    def has_new(self) -> bool:
        """Whether a row was published since the last `read`."""
        return self.ring.count > self._next

    def read(self, most: int | None = None) -> Rows:
        """Copies of the rows published since the last call, oldest first, at most `most`; shape (k,)."""
        ring = self.ring
        end = ring.count
        fence()
        first = self._skip(end)
        if most is not None:
            end = min(end, first + most)
        rows = ring._rows[np.arange(first, end) % ring.capacity]
        fence()
        self._next = first
        kept = self._skip(ring.count)
        self._next = max(end, kept)
        return rows[kept - first :]

    def _skip(self, count: int) -> int:
        """Number of the first unread row that the writer cannot be overwriting now; rows before it count as lost."""
        first = max(self._next, count - self.ring.capacity + 1, 0)
        self.lost += first - self._next
        self._next = first
        return first
