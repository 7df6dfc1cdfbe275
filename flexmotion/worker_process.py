"""What every worker process of a pool begins with: one thread for linear algebra, and an end with its parent."""

from __future__ import annotations

import multiprocessing
import os
import threading


def limit_threads() -> None:
    """Limit processes that are spawned from here on to one thread: there is a process per core."""
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ[name] = "1"


def begin_worker() -> None:
    """Initializer of a pool's processes."""
    limit_threads()
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    """End with the parent: a killed parent cannot stop its workers, which would wait for work forever."""
    parent = multiprocessing.parent_process()
    assert parent is not None
    parent.join()
    os._exit(1)
