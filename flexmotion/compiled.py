"""Loops over numbers that are compiled to machine code (numba): what is done for every joint of every row.

`compiled` compiles a function for one signature when its module is loaded, never while a robot moves: arguments of
other types are refused with a TypeError. Bounds are not checked: callers give arrays of the lengths that are told.

The code is kept beside the module, or in the user's cache (`NUMBA_CACHE_DIR`: elsewhere), and takes its seconds once
after an installation. It is made again where its file has changed, or a number that its module knows, numba or the
processor, and where its files are not as they were written. `part` marks a function that compiled ones of the same file
call, above them in that file: a change in another file would not be noticed.
"""

from __future__ import annotations

import hashlib
import json
import logging
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple, TypeVar, cast

import numba
import numpy as np
from llvmlite.binding import get_host_cpu_name
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

_told: set[str] = set()
"""What was told once in this process."""
_unkept: set[str] = set()


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


def doubles(array: Any) -> np.ndarray[Any, np.dtype[np.float64]]:
    """An array as `FLOATS` needs it."""
    return np.ascontiguousarray(array, np.float64)


def part(function: F) -> F:
    """A function that compiled ones of its file call."""
    return cast(F, numba.njit(error_model="numpy")(function))


def compiled(*arguments: types.Type) -> Callable[[F], F]:
    """A function that is compiled for arguments of these types, now or from what was kept."""

    def compile_it(function: F) -> F:
        if cast(Any, numba.config).DISABLE_JIT:  # NUMBA_DISABLE_JIT=1: plain Python, for a debugger
            return function
        try:
            found = numba.njit(cache=True, error_model="numpy")(function)
            kept = _Kept(found)
            if not kept.are_sound():
                kept.remove()
                _tell("compiling loops for this processor, once after an installation: about a minute")
            found.compile(arguments)
            if found.stats.cache_misses:
                kept.seal()
        except (RuntimeError, OSError) as error:
            # No folder can be written, or there is no room in it.
            log.info("%s: %s", function.__qualname__, error)
            _tell(
                "compiling loops for this processor, about a minute, at every start: the package's folder and the "
                "user's cache cannot be written; NUMBA_CACHE_DIR names another one"
            )
            _unkept.add(function.__qualname__)
            found = numba.njit(error_model="numpy")(function)
            found.compile(arguments)
        found.disable_compile()
        return cast(F, found)

    return compile_it


def unkept() -> frozenset[str]:
    """Functions of the modules that are loaded whose code is not kept: they are compiled at every start."""
    return frozenset(_unkept)


class _Kept:
    """Files with the kept code of a function, and a seal: what they were made of, and their digests.

    numba would run a file that a loss of power has cut off or emptied, which ends the process without a word.
    """

    def __init__(self, function: Any) -> None:
        code = function.py_func.__code__
        name = f"{Path(code.co_filename).stem}.{function.py_func.__qualname__}-{code.co_firstlineno}"
        self._folder, self._name = Path(function.stats.cache_path), name
        self._seal = self._folder / f"{name}.seal"
        numbers = {key: _digits(value) for key, value in sorted(function.py_func.__globals__.items())}
        known = {key: value for key, value in numbers.items() if value is not None}
        self._made_of = [numba.__version__, get_host_cpu_name(), known]

    @property
    def _files(self) -> list[Path]:
        return sorted(self._folder.glob(f"{self._name}.*.nb[ic]"))

    def _sealed(self) -> str:
        """What the seal says of the files as they are."""
        digests = {file.name: hashlib.sha256(file.read_bytes()).hexdigest() for file in self._files}
        return json.dumps({"made of": self._made_of, "files": digests})

    def are_sound(self) -> bool:
        """Whether there is code that was made of the same, as it was written."""
        try:
            return self._seal.read_text(encoding="utf-8") == self._sealed()
        except (FileNotFoundError, UnicodeDecodeError):
            return False

    def remove(self) -> None:
        """Remove them, so that they are made again."""
        for file in (self._seal, *self._files):
            file.unlink(missing_ok=True)

    def seal(self) -> None:
        """Tell that the files are as they were written."""
        part_file = self._seal.with_suffix(f".{os.getpid()}")
        part_file.write_text(self._sealed(), encoding="utf-8")
        part_file.replace(self._seal)


def _digits(value: Any) -> str | None:
    """A number, or numbers in tuples or an array, as text; None: it is something else."""
    if isinstance(value, np.ndarray):
        return hashlib.sha256(value.tobytes()).hexdigest() if value.dtype.kind in "biuf" else None
    if isinstance(value, tuple):
        parts = [_digits(one) for one in value]
        return None if None in parts else f"({','.join(map(str, parts))})"
    return repr(value) if isinstance(value, int | float) else None


def _tell(text: str) -> None:
    if text not in _told:
        log.warning(text)
        _told.add(text)
