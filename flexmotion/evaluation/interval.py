"""`Interval`: a figure with its 95 % interval."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

REPETITIONS = 20


@dataclass(frozen=True)
class Interval:
    """A mean and the half width of its 95 % interval."""

    mean: float
    half_width: float

    @classmethod
    def of(cls, values: ArrayLike) -> Interval:
        """Mean of independent values ± 1.96 standard errors; NaN for no values."""
        found = np.asarray(values, np.float64).ravel()
        if not len(found):
            return cls(float("nan"), float("nan"))
        return cls(float(found.mean()), float(1.96 * found.std() / np.sqrt(len(found))))

    def __str__(self) -> str:
        return f"{self.mean:.4g} ± {self.half_width:.2g}"


def repeated(metric: Callable[[np.random.Generator], float], seed: int, repetitions: int = REPETITIONS) -> Interval:
    """Interval of a metric with random draws, from repeated evaluations."""
    return Interval.of([metric(np.random.default_rng((seed, number))) for number in range(repetitions)])
