"""Vectors in the frame of the heading."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from flexmotion.features.heading_frame import chord, turned, yaw_matrix

SPEED = st.floats(-2.0, 2.0)


@given(SPEED, SPEED, SPEED)
def test_the_chord_of_an_arc_is_the_sum_of_its_steps(forward: float, left: float, turning: float) -> None:
    """Regression: walking forward while turning was requested as oblique walking, which the data hardly have."""
    seconds, count = 32 / 30, 2000
    yaw = turning * seconds * (np.arange(count) + 0.5) / count
    steps = turned(np.tile([forward, left, 0.0], (count, 1)), yaw)
    assert chord(forward, left, turning, seconds) == pytest.approx(tuple(steps.mean(axis=0)[:2]), abs=1e-5)


def test_without_turning_the_chord_is_the_velocity() -> None:
    assert chord(0.7, -0.2, 0.0, 1.0) == (0.7, -0.2)


def test_turned_is_the_matrix() -> None:
    rng = np.random.default_rng(0)
    vectors, yaw = rng.normal(size=(5, 2, 3)), rng.normal(size=5)
    np.testing.assert_allclose(turned(vectors, yaw), np.einsum("tij,tkj->tki", yaw_matrix(yaw), vectors))
