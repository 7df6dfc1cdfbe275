"""`Interval`: a figure that depends on what was drawn, with how well it is known."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

REPETITIONS = 20


@dataclass(frozen=True)
class Interval:
    """A mean, and the half width of its 95 % interval."""

    mean: float
    half_width: float

    @classmethod
    def of(cls, values: ArrayLike) -> Interval:
        """Of independent values, 1.96 standard errors to either side; NaN of none."""
        found = np.asarray(values, np.float64).ravel()
        if not len(found):
            return cls(float("nan"), float("nan"))
        return cls(float(found.mean()), float(1.96 * found.std() / np.sqrt(len(found))))

    def __str__(self) -> str:
        return f"{self.mean:.4g} ± {self.half_width:.2g}"


def repeated(metric: Callable[[np.random.Generator], float], seed: int, repetitions: int = REPETITIONS) -> Interval:
    """A metric that depends on what is drawn, several times."""
    return Interval.of([metric(np.random.default_rng((seed, number))) for number in range(repetitions)])
