"""The search: within bounds, the same for the same costs, whoever else draws random numbers."""

from __future__ import annotations

import sys

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from flexmotion.configs.errors import ConfigError
from flexmotion.streamer.tuning.search import Search, default_population


def distance(candidate: np.ndarray) -> float:
    return float(np.sum((candidate - 0.8) ** 2))


@pytest.mark.parametrize("numbers", [1, 2, 4])
def test_it_finds_the_least_cost(numbers: int) -> None:
    search, least = Search([0.2] * numbers, 8, seed=1), np.inf
    for _ in range(20):
        asked = search.ask()
        assert all(one.shape == (numbers,) for one in asked)
        search.tell([distance(one) for one in asked])
        least = min(least, *(distance(one) for one in asked))
    assert least < 1e-2 < distance(np.full(numbers, 0.2))


@given(
    st.lists(st.floats(0.0, 1.0), min_size=1, max_size=3),
    st.lists(st.floats(0.0, 1e3), min_size=12, max_size=12),
    st.integers(0, 9),
)
def test_candidates_are_within_bounds_and_follow_from_seed_and_costs(
    start: list[float], costs: list[float], seed: int
) -> None:
    first, second = Search(start, 4, seed), Search(start, 4, seed)
    for generation in range(3):
        asked = first.ask()
        np.random.seed(generation)  # somebody else's numbers
        again = second.ask()
        assert np.array_equal(asked, again)
        assert all(((one >= 0.0) & (one <= 1.0)).all() for one in asked)
        own = costs[4 * generation : 4 * generation + 4]
        first.tell(own)
        second.tell(own)


def test_seeds_differ() -> None:
    one, other = (Search([0.5, 0.5], 4, seed).ask() for seed in (0, 1))
    assert not np.array_equal(one, other)


def test_more_numbers_ask_for_more_candidates() -> None:
    assert [default_population(numbers) for numbers in (1, 3, 10)] == [6, 7, 10]


def test_without_cma_the_extra_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    import importlib.util

    real = importlib.util.find_spec
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None if name == "cma" else real(name))
    monkeypatch.delitem(sys.modules, "cma", raising=False)
    with pytest.raises(ConfigError, match=r"needs the extra 'tune'.*pip install '\.\[tune\]'"):
        Search([0.5], 4, 0)
