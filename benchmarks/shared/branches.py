"""`in_branch`: carries a session in lockstep on in a copy of this process; the session itself stays where it is."""

from __future__ import annotations

import mmap
import os
import pickle
from collections.abc import Callable
from contextlib import AbstractContextManager
from functools import partial
from typing import TypeVar
from unittest.mock import patch

Found = TypeVar("Found")


def copied_memory() -> AbstractContextManager[object]:
    """Context in which memory is made that a forked process has a copy of, instead of sharing it."""
    private = partial(mmap.mmap, flags=mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS)
    return patch.object(mmap, "mmap", private)


def in_branch(function: Callable[[], Found]) -> Found:
    """What a function finds in a forked process, or its error; sessions must have been opened in `copied_memory`."""
    reader, writer = os.pipe()
    child = os.fork()
    if child == 0:
        with os.fdopen(writer, "wb") as out:
            try:
                pickle.dump((function(), None), out)
            except BaseException as error:
                pickle.dump((None, error), out)
        os._exit(0)
    os.close(writer)
    with os.fdopen(reader, "rb") as answer:
        found, failure = pickle.load(answer)
    os.waitpid(child, 0)
    if failure is not None:
        raise failure
    return found
