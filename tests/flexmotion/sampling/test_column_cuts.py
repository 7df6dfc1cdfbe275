"""Derivatives of some columns are those of the whole, and made once."""

from __future__ import annotations

import numpy as np
import pytest

from flexmotion.sampling.column_cuts import KEPT, ColumnCuts

WHOLE = np.random.default_rng(0).normal(size=(4, 50, 3)).astype(np.float32)


def test_a_cut_is_made_once_and_cannot_be_changed() -> None:
    cuts, columns = ColumnCuts(WHOLE), np.array([0, 7, 49])
    found = cuts.of(columns)
    np.testing.assert_array_equal(found, WHOLE[:, columns])
    assert cuts.of(columns.copy()) is found
    with pytest.raises(ValueError, match="read-only"):
        found[0] = 0.0


def test_all_columns_are_no_copy() -> None:
    assert ColumnCuts(WHOLE).of(np.arange(50)) is WHOLE


def test_cuts_of_many_requests_are_right_though_few_are_kept() -> None:
    cuts = ColumnCuts(WHOLE)
    for _ in range(2):
        for first in range(2 * KEPT):
            np.testing.assert_array_equal(cuts.of(np.arange(first, first + 3)), WHOLE[:, first : first + 3])
