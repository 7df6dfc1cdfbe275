"""The rotations of a plan against SciPy's."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from flexmotion.spatial.rotations import (
    matrices,
    matrix_quaternions,
    rotation_vectors,
    turns,
    vector_quaternions,
    yaw_matrices,
    zyx_quaternion,
    zyx_yaw_pitch,
)


@pytest.fixture
def angles() -> np.ndarray:
    """Yaw of several turns, pitch below a right angle, roll, (200, 3) [rad]."""
    return np.random.default_rng(0).uniform([-9.0, -1.5, -3.0], [9.0, 1.5, 3.0], (200, 3))


def test_euler_angles_as_quaternions_and_matrices(angles: np.ndarray) -> None:
    expected = Rotation.from_euler("ZYX", angles)
    quaternions = zyx_quaternion(*angles.T)
    np.testing.assert_allclose(matrices(quaternions), expected.as_matrix(), atol=1e-14)
    np.testing.assert_allclose(
        np.abs(np.sum(quaternions * expected.as_quat(scalar_first=True), axis=1)), 1.0, atol=1e-14
    )
    found = np.column_stack(zyx_yaw_pitch(expected.as_matrix()))
    np.testing.assert_allclose(found, expected.as_euler("ZYX")[:, :2], atol=1e-9)
    yaw = angles[:, 0]
    np.testing.assert_allclose(yaw_matrices(yaw), Rotation.from_euler("z", yaw[:, None]).as_matrix(), atol=1e-14)


def test_quaternions_are_continuous_over_full_turns() -> None:
    """Those taken from a matrix change their sign where the heading passes pi."""
    yaw = np.linspace(-8.0, 8.0, 1000)
    found = zyx_quaternion(yaw, np.full(1000, 0.2), np.full(1000, -0.1))
    assert np.abs(np.diff(found, axis=0)).max() < 0.01


@pytest.mark.parametrize("size", [0.0, 1e-12, 1e-6, 0.01, 3.0], ids=str)
def test_turns_from_row_to_row(size: float) -> None:
    rng = np.random.default_rng(1)
    steps = rng.normal(size=(99, 3))
    steps *= size / np.linalg.norm(steps, axis=1, keepdims=True)
    rotation = [Rotation.random(random_state=2)]
    for step in steps:
        rotation.append(rotation[-1] * Rotation.from_rotvec(step))
    quaternions = np.stack([one.as_quat(scalar_first=True) for one in rotation])
    quaternions[::3] *= -1.0
    np.testing.assert_allclose(turns(quaternions), steps, rtol=1e-9, atol=1e-15)


def test_quaternions_of_matrices() -> None:
    """Half turns about each axis too, where one component alone is not small."""
    half = Rotation.from_rotvec(np.pi * np.eye(3))
    every = Rotation.concatenate([Rotation.random(500, random_state=3), Rotation.identity(), half])
    found = matrix_quaternions(every.as_matrix().reshape(-1, 2, 3, 3)).reshape(-1, 4)
    expected = every.as_quat(scalar_first=True)
    greatest = np.take_along_axis(expected, np.abs(expected).argmax(axis=1)[:, None], axis=1)
    np.testing.assert_allclose(found, expected * np.sign(greatest), atol=1e-14)


@pytest.mark.parametrize("size", [0.0, 1e-12, 1e-6, 0.01, 3.1], ids=str)
def test_rotation_vectors_and_back(size: float) -> None:
    vectors = np.random.default_rng(4).normal(size=(5, 6, 3))
    vectors *= size / np.linalg.norm(vectors, axis=-1, keepdims=True)
    quaternions = vector_quaternions(vectors)
    expected = Rotation.from_rotvec(vectors.reshape(-1, 3)).as_matrix().reshape(5, 6, 3, 3)
    np.testing.assert_allclose(matrices(quaternions), expected, atol=1e-15)
    np.testing.assert_allclose(rotation_vectors(-quaternions), vectors, rtol=1e-9, atol=1e-15)
