from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from flexmotion.drivers.masks import every, some


@given(st.lists(st.booleans(), max_size=40))
def test_they_are_all_and_any(values: list[bool]) -> None:
    mask = np.array(values, np.bool_)
    assert every(mask) == mask.all() and some(mask) == mask.any()


@given(st.lists(st.integers(-(2**40), 2**40), max_size=10))
def test_any_of_whole_numbers(values: list[int]) -> None:
    assert some(np.array(values, np.int64)) == any(values)
