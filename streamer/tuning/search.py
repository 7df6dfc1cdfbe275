"""`Search`: covariance matrix adaptation (CMA-ES, Hansen 2016) within bounds, from its seed and the costs alone.

The search is not stored. What it asks follows from the seed and the costs it was told, so that a search to which the
same costs are told again is where the first one was.
"""

from __future__ import annotations

import importlib.util
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from flexmotion.configs.errors import ConfigError

Float = NDArray[np.float64]

STEP = 0.15
"""Standard deviation of the first generation, over the distance of the bounds: two thirds within 15 % of it."""
LEAST_DIMENSIONS = 2
"""Of what `cma` searches; a single number gets a second one beside it, which means nothing."""


def needs_cma() -> None:
    """Raise `ConfigError` where the library of the extra `tune` is not installed."""
    if importlib.util.find_spec("cma") is None:
        raise ConfigError("tuning needs the extra 'tune': in a clone, pip install '.[tune]'")


def default_population(numbers: int) -> int:
    """Candidates of a generation: 4 + 3 ln(n), as in Hansen 2016."""
    return 4 + int(3 * np.log(max(numbers, LEAST_DIMENSIONS)))


class Search:
    """Asks for candidates, generation by generation.

    Args:
        start: where it begins, in [0, 1], one share of the distance of the bounds for each number.
        population: candidates of a generation.
        seed: of what it draws.

    Raises:
        ConfigError: `cma` is not installed.
    """

    def __init__(self, start: Sequence[float], population: int, seed: int) -> None:
        needs_cma()
        import cma

        self._numbers = len(start)
        free = np.full(max(LEAST_DIMENSIONS - len(start), 0), 0.5)
        generator = np.random.default_rng(seed)
        options = {
            "bounds": [0.0, 1.0],
            "popsize": population,
            # Random numbers of its own: those of NumPy's global state depend on who else draws.
            "seed": np.nan,
            "randn": lambda *shape: generator.standard_normal(shape),
            "verbose": -9,
            "verb_log": 0,
        }
        self._strategy = cma.CMAEvolutionStrategy(np.concatenate([np.asarray(start, float), free]), STEP, options)
        self._asked: list[Float] = []

    def ask(self) -> list[Float]:
        """The candidates of the next generation: shares in [0, 1], (n,) each."""
        self._asked = self._strategy.ask()
        return [np.clip(one[: self._numbers], 0.0, 1.0) for one in self._asked]

    def tell(self, costs: Sequence[float]) -> None:
        """The costs of the candidates that were asked for, in their order."""
        self._strategy.tell(self._asked, list(costs))
