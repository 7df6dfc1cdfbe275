"""`Statistics`: mean and spread of every feature, by which networks see them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexmotion.features.layout import Layout

FLOOR = 0.1
"""Least spread of a feature, as a share of its block's: a feature that hardly moves is not blown up to noise."""


@dataclass(frozen=True)
class Statistics:
    """Mean and spread of every feature, (F,) each, float32."""

    mean: NDArray[np.float32]
    spread: NDArray[np.float32]

    @classmethod
    def of(cls, features: NDArray, layout: Layout) -> Statistics:
        """Of features, (N, F), block by block with a least spread."""
        mean, spread = features.mean(axis=0, dtype=np.float64), features.std(axis=0, dtype=np.float64)
        for columns in layout.blocks.values():
            block = np.sqrt(np.mean(spread[columns] ** 2))
            spread[columns] = np.maximum(spread[columns], FLOOR * block if block > 0 else 1.0)
        return cls(mean.astype(np.float32), spread.astype(np.float32))

    def normalise(self, features: NDArray) -> NDArray[np.float32]:
        """Features as networks see them."""
        return ((features - self.mean) / self.spread).astype(np.float32)

    def restore(self, normalised: NDArray) -> NDArray[np.float32]:
        """The inverse of `normalise`."""
        return (normalised * self.spread + self.mean).astype(np.float32)
