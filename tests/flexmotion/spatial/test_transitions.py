"""Smooth transitions from 0 to 1."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from flexmotion.spatial.transitions import minimum_jerk, smoothstep

S = np.linspace(0.0, 1.0, 1001)


@pytest.mark.parametrize("rise", [smoothstep, minimum_jerk])
def test_rises_from_rest_to_rest(rise: Callable[[np.ndarray], np.ndarray]) -> None:
    np.testing.assert_array_equal(rise(np.array([-1.0, 0.0, 0.5, 1.0, 2.0])), [0, 0, 0.5, 1, 1])
    slope = np.diff(rise(S)) / S[1]
    assert (slope >= 0).all()
    assert abs(slope[0]) < 5e-3 and abs(slope[-1]) < 5e-3


def test_minimum_jerk_starts_without_acceleration() -> None:
    curvature = np.diff(minimum_jerk(S), 2) / S[1] ** 2
    assert np.gradient(minimum_jerk(S), S).max() == pytest.approx(15 / 8, rel=1e-4)
    assert abs(curvature[0]) < 0.1 and abs(curvature[-1]) < 0.1
    assert np.diff(smoothstep(S), 2)[0] / S[1] ** 2 == pytest.approx(6.0, rel=0.01)


def test_smoothstep_between_limits() -> None:
    np.testing.assert_array_equal(smoothstep(np.array([1.0, 2.0, 3.0, 4.0, 5.0]), 2.0, 4.0), [0, 0, 0.5, 1, 1])
