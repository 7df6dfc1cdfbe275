"""Splines agree with those of scipy, whose formulas they share, at both kinds of ends and any places."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from flexmotion.retarget.splines import Spline

Float = NDArray[np.float64]


@given(st.integers(0, 2**32 - 1), st.integers(2, 40), st.booleans())
def test_values_and_derivatives_are_those_of_scipy(seed: int, count: int, natural: bool) -> None:
    count = count if natural else max(count, 4)
    random = np.random.default_rng(seed)
    places = random.uniform(-5.0, 5.0) + np.cumsum(random.uniform(0.1, 2.0, count))
    values = random.normal(size=(count, 3))
    at = np.concatenate([places, random.uniform(places[0], places[-1], 50)])
    found = Spline(places, values, natural=natural).at(at)
    reference = CubicSpline(places, values, bc_type="natural" if natural else "not-a-knot")
    for order, own in enumerate(found):
        wanted = reference(at, order)
        np.testing.assert_allclose(own, wanted, rtol=0.0, atol=1e-9 * max(1.0, np.abs(wanted).max()))


def test_two_places_are_joined_by_a_line() -> None:
    """A source of two frames is a window too."""
    found = Spline(np.array([1.0, 3.0]), np.array([[0.0], [4.0]]), natural=True).at(np.array([1.0, 2.0, 3.0]))
    np.testing.assert_allclose(found.value[:, 0], [0.0, 2.0, 4.0])
    np.testing.assert_allclose(found.first, 2.0)
    np.testing.assert_allclose(found.second, 0.0)


def test_a_cubic_is_met_between_its_places_where_no_end_is_a_knot() -> None:
    def cubic(x: Float) -> Float:
        return 0.3 * x**3 - x**2 + 2.0 * x - 1.0

    places = np.array([0.0, 4.0, 8.0, 12.0, 13.0])
    at = np.linspace(0.0, 13.0, 27)
    found = Spline(places, cubic(places)[:, None], natural=False).at(at)
    assert found.value[:, 0] == pytest.approx(cubic(at), abs=1e-9)
    assert found.first[:, 0] == pytest.approx(0.9 * at**2 - 2.0 * at + 2.0, abs=1e-9)
