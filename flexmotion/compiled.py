"""Loops over numbers that are compiled to machine code (numba): what is done for every joint of every row.

`compiled` compiles a function for one signature when its module is loaded, never while a robot moves; arguments of
other types are refused with a TypeError. What was compiled is kept beside the module, or in the user's cache, so that
it takes its seconds once after an installation. `part` marks a function that compiled ones of the same file call; a
file's compiled code is made again when that file changes, so that a part must not lie in another one.
"""

from __future__ import annotations

import logging
from collections.abc import Callable
from typing import Any, NamedTuple, TypeVar, cast

import numba
from numba import types

log = logging.getLogger(__name__)

F = TypeVar("F", bound=Callable[..., Any])

FLOAT, INT, BOOL = types.float64, types.int64, types.boolean
FLOATS = {rank: types.Array(FLOAT, rank, "C", readonly=True) for rank in range(1, 6)}
"""Type of a contiguous array of floats by its rank."""
ANY = {rank: types.Array(FLOAT, rank, "A", readonly=True) for rank in range(1, 6)}
"""Type of an array of floats of any strides by its rank."""
INTS = {rank: types.Array(INT, rank, "C", readonly=True) for rank in range(1, 3)}
"""Type of a contiguous array of integers by its rank."""


def fields(record: type[NamedTuple], *kinds: types.Type) -> types.Type:
    """Type of a named tuple with fields of these types; its arrays must be writable, others need not be."""
    own = [kind.copy(readonly=False) if isinstance(kind, types.Array) else kind for kind in kinds]
    return types.BaseTuple.from_types(own, record)


def part(function: F) -> F:
    """A function that compiled ones of its file call."""
    return cast(F, numba.njit(error_model="numpy")(function))


def compiled(*arguments: types.Type) -> Callable[[F], F]:
    """A function that is compiled for arguments of these types, now or from what was kept."""

    def compile_it(function: F) -> F:
        try:
            found = numba.njit(cache=True, error_model="numpy")(function)
        except RuntimeError:  # neither the module's folder nor the user's cache can be written
            log.warning("%s is compiled at every start: no folder to keep it in can be written", function.__qualname__)
            found = numba.njit(error_model="numpy")(function)
        found.compile(arguments)
        return cast(F, found)

    return compile_it
