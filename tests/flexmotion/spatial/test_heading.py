"""Heading of quaternions and matrices."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from flexmotion.spatial.heading import continuous_heading, continuous_matrix_heading, heading, matrix_heading, wrapped


@pytest.mark.parametrize("yaw", [-3.0, -1.0, 0.0, 2.0])
@pytest.mark.parametrize("pitch", [0.0, 0.8, 1.7])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_heading_survives_a_deep_bow(yaw: float, pitch: float, sign: float) -> None:
    rotation = Rotation.from_euler("ZY", [yaw, pitch])
    assert matrix_heading(rotation.as_matrix()) == pytest.approx(yaw)
    assert heading(sign * rotation.as_quat(scalar_first=True)) == pytest.approx(yaw)


def test_quaternions_and_matrices_have_one_heading() -> None:
    rotations = Rotation.random(200, rng=1)
    expected = np.exp(1j * matrix_heading(rotations.as_matrix()))
    found = heading(rotations.as_quat(scalar_first=True))
    np.testing.assert_allclose(np.exp(1j * found), expected, atol=1e-9)
    assert np.abs(found).max() <= np.pi


def test_unknown_stays_unknown() -> None:
    assert np.isnan(heading(np.array([[np.nan] * 4, [1.0, 0, 0, 0]]))).tolist() == [True, False]


def test_continuous_headings_count_turns() -> None:
    yaw = np.linspace(0, 5 * np.pi, 60)
    rotations = Rotation.from_euler("z", yaw[:, None])
    np.testing.assert_allclose(continuous_matrix_heading(rotations.as_matrix()), yaw, atol=1e-9)
    np.testing.assert_allclose(continuous_heading(rotations.as_quat(scalar_first=True)), yaw, atol=1e-9)


@given(st.floats(-np.pi, np.pi), st.integers(-3, 3))
def test_an_angle_is_the_same_within_half_a_turn(angle: float, turns: int) -> None:
    found = wrapped(angle + 2 * np.pi * turns)
    assert abs(found) <= np.pi
    assert np.cos(found - angle) == pytest.approx(1.0)
