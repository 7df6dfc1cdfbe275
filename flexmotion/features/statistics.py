"""`Statistics`: mean and spread of every feature, for normalisation."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexmotion.features.layout import Layout

FLOOR = 0.1
"""Least spread of a feature as a share of its block's: nearly constant features are not amplified to noise."""


@dataclass(frozen=True)
class Statistics:
    """Mean and spread of every feature, (F,) each, float32."""

    mean: NDArray[np.float32]
    spread: NDArray[np.float32]

    @classmethod
    def of(cls, features: NDArray, layout: Layout) -> Statistics:
        """Statistics of features, (N, F), with a least spread per block."""
        mean, spread = features.mean(axis=0, dtype=np.float64), features.std(axis=0, dtype=np.float64)
        for columns in layout.blocks.values():
            block = np.sqrt(np.mean(spread[columns] ** 2))
            spread[columns] = np.maximum(spread[columns], FLOOR * block if block > 0 else 1.0)
        return cls(mean.astype(np.float32), spread.astype(np.float32))

    def normalise(self, features: NDArray) -> NDArray[np.float32]:
        """Features of mean 0 and spread 1."""
        return ((features - self.mean) / self.spread).astype(np.float32)

    def restore(self, normalised: NDArray) -> NDArray[np.float32]:
        """The inverse of `normalise`."""
        return (normalised * self.spread + self.mean).astype(np.float32)
