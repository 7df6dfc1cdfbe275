"""Loops over numbers that are compiled to machine code (numba): what is done for every joint of every row.

`compiled` compiles a function for one signature when its module is loaded, never while a robot moves: arguments of
other types are refused with a TypeError. The code is kept beside the module, or in the user's cache, and takes its
seconds once after an installation. `part` marks a function that compiled ones of the same file call, above them in that
file: kept code is made again when its file changes, and does not notice a change in another one.
"""

from __future__ import annotations

import logging
import pickle
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple, TypeVar, cast

import numba
import numpy as np
from numba import types

log = logging.getLogger(__name__)

F = TypeVar("F", bound=Callable[..., Any])
R = TypeVar("R")

FLOAT, INT, BOOL = types.float64, types.int64, types.boolean
FLOATS = {rank: types.Array(FLOAT, rank, "C", readonly=True) for rank in range(1, 6)}
"""Type of a contiguous array of floats by its rank."""
ANY = {rank: types.Array(FLOAT, rank, "A", readonly=True) for rank in range(1, 6)}
"""Type of an array of floats of any strides by its rank."""
INTS = {rank: types.Array(INT, rank, "C", readonly=True) for rank in range(1, 3)}
"""Type of a contiguous array of integers by its rank."""

_told: list[str] = []
"""That code is compiled, told once a process."""


def fields(record: type[NamedTuple], *kinds: types.Type) -> types.Type:
    """Type of a named tuple with fields of these types; its arrays must be writable (see `packed`), others need not."""
    own = [kind.copy(readonly=False) if isinstance(kind, types.Array) else kind for kind in kinds]
    return types.BaseTuple.from_types(own, record)


def packed(record: Callable[..., R], **values: Any) -> R:
    """A named tuple of constants, whose arrays are as `fields` needs them: contiguous, writable, of 64 bits."""
    own = dict(values)
    for name, value in values.items():
        if isinstance(value, np.ndarray):
            own[name] = np.require(value, np.float64 if value.dtype.kind == "f" else np.int64, ("C", "W"))
    return record(**own)


def part(function: F) -> F:
    """A function that compiled ones of its file call."""
    return cast(F, numba.njit(error_model="numpy")(function))


def compiled(*arguments: types.Type) -> Callable[[F], F]:
    """A function that is compiled for arguments of these types, now or from what was kept."""

    def compile_it(function: F) -> F:
        try:
            found = numba.njit(cache=True, error_model="numpy")(function)
        except RuntimeError:
            _tell(f"{function.__qualname__}: compiled at every start, as no folder to keep its code in can be written")
            found = numba.njit(error_model="numpy")(function)
        else:
            if not _kept(found):
                _tell("compiling loops for this processor, once after an installation: about a minute")
        try:
            found.compile(arguments)
        except (EOFError, pickle.UnpicklingError):
            # Files that a loss of power cut off.
            for file in _kept(found):
                file.unlink(missing_ok=True)
            found = numba.njit(cache=True, error_model="numpy")(function)
            found.compile(arguments)
        found.disable_compile()
        return cast(F, found)

    return compile_it


def _kept(function: Any) -> list[Path]:
    """Files with the kept code of a function."""
    code = function.py_func.__code__
    name = f"{Path(code.co_filename).stem}.{function.py_func.__qualname__}-{code.co_firstlineno}.*.nb[ic]"
    return sorted(Path(function.stats.cache_path).glob(name))


def _tell(text: str) -> None:
    if not _told:
        log.warning(text)
        _told.append(text)
