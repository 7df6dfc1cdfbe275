"""Unit quaternions over time."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from flexmotion.spatial.quaternions import continuous_quaternions


@pytest.mark.parametrize("shape", [(20,), (20, 3)])
def test_continuous_quaternions_only_change_signs(shape: tuple[int, ...]) -> None:
    q = Rotation.random(int(np.prod(shape)), rng=1).as_quat().reshape(*shape, 4)
    result = continuous_quaternions(q)
    np.testing.assert_array_equal(np.abs(result), np.abs(q))
    np.testing.assert_array_equal(result[0], q[0])
    assert (np.sum(result[1:] * result[:-1], axis=-1) >= 0).all()


def test_no_frames() -> None:
    assert continuous_quaternions(np.zeros((0, 4))).shape == (0, 4)
