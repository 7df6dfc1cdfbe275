"""Points spread evenly over a unit cube."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import qmc

from flexmotion.retarget.spread_points import MOST_DIMENSIONS, halton, sobol


@pytest.mark.parametrize("dimensions", [1, 3, 7])
def test_halton_is_that_of_scipy(dimensions: int) -> None:
    np.testing.assert_allclose(
        halton(200, dimensions), qmc.Halton(dimensions, scramble=False).random(200), rtol=0, atol=1e-15
    )


@pytest.mark.parametrize("dimensions", [1, 3, MOST_DIMENSIONS])
def test_sobol_is_that_of_scipy(dimensions: int) -> None:
    np.testing.assert_array_equal(sobol(9, dimensions), qmc.Sobol(dimensions, scramble=False).random_base2(9))


def test_each_half_of_a_joint_has_half_of_the_points() -> None:
    assert (np.count_nonzero(sobol(9, 5) < 0.5, axis=0) == 256).all()


def test_more_dimensions_than_the_table_has_are_refused() -> None:
    with pytest.raises(ValueError, match=f"{MOST_DIMENSIONS + 1} dimensions"):
        sobol(3, MOST_DIMENSIONS + 1)
