"""The rotations of a plan against SciPy's."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from flexmotion.spatial.rotations import matrices, turns, yaw_matrices, zyx_quaternion, zyx_yaw_pitch


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
