"""`Ring`: rows of a fixed size in memory that forked processes share; one writes, any number read, nobody waits.

The memory has no name: it is gone when the last process that has it is, however that process ends.
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

    What comes before cannot sink below the first release, what comes after cannot rise above the second acquire, and
    a lock's own operations keep their order.
    """
    for _ in range(2):
        _barrier.acquire()
        _barrier.release()


def shared_array(shape: int | tuple[int, ...], dtype: np.dtype[Any] | type) -> Rows:
    """An array of zeros that processes forked from this one share."""
    kind = np.dtype(dtype)
    count = int(np.prod(shape, dtype=np.int64))
    memory = mmap.mmap(-1, max(count * kind.itemsize, 1))
    return np.frombuffer(memory, kind, count).reshape(shape)


def touch(array: Rows) -> None:
    """Read every page of a shared array, so that this process meets no page fault in it later."""
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
        # The writer would have to lap the whole ring during this copy to spoil it.
        fence()
        return self._rows[(count - 1) % self.capacity].copy()

    def touch(self) -> None:
        """See `touch`."""
        touch(self._rows)

    def reader(self) -> Reader:
        """A reader that begins with the oldest row still there."""
        return Reader(self)


class Reader:
    """Follows a ring.

    Attributes:
        lost: rows that were overwritten before they were read.
    """

    def __init__(self, ring: Ring) -> None:
        self.ring = ring
        self.lost = 0
        self._next = 0

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
        """First row that the writer cannot be overwriting now; what is before it counts as lost."""
        first = max(self._next, count - self.ring.capacity + 1, 0)
        self.lost += first - self._next
        self._next = first
        return first
