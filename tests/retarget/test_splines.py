from __future__ import annotations

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from flexmotion.retarget.splines import Spline

AT = np.linspace(0.0, 1.0, 23)


@pytest.mark.parametrize(("count", "natural"), [(2, True), (3, True), (4, True), (4, False), (5, False), (30, False)])
def test_it_is_the_spline_of_scipy(count: int, natural: bool) -> None:
    rng = np.random.default_rng(count)
    places = np.sort(np.concatenate([[0.0, 1.0], rng.uniform(0.1, 0.9, count - 2)]))
    values = rng.normal(size=(count, 3))
    expected = CubicSpline(places, values, bc_type="natural" if natural else "not-a-knot")
    for order, found in enumerate(Spline(places, values, natural=natural).at(AT)):
        reference = expected(AT, order)
        np.testing.assert_allclose(found, reference, atol=1e-9 * max(np.abs(reference).max(), 1.0))
