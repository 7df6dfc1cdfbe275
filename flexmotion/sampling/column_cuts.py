"""`ColumnCuts`: derivatives of a window's rotations by its latent, of the columns of some joints."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

Float32 = NDArray[np.float32]

KEPT = 8
"""Cuts that are kept: those of the feet, and of what was asked last; a cut has at most 1.2 MB."""


class ColumnCuts:
    """Cuts of derivatives that are too large for a processor's cache, made once for each set of columns.

    Args:
        whole: derivatives of the features of the block `rotations`, (W, 50, L).
    """

    def __init__(self, whole: Float32) -> None:
        self.whole = whole
        self._made = lru_cache(maxsize=KEPT)(self._cut)

    def of(self, columns: NDArray[np.intp]) -> Float32:
        """Derivatives of K columns, (W, K, L)."""
        return self.whole if len(columns) == self.whole.shape[1] else self._made(tuple(columns.tolist()))

    def _cut(self, columns: tuple[int, ...]) -> Float32:
        found = np.ascontiguousarray(self.whole[:, list(columns)])
        found.setflags(write=False)
        return found
