from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from flexmotion.retarget.swing import PEAK_ACCELERATION, swing_path

CLEARANCE = 0.022
poses = st.tuples(*[st.floats(-0.3, 0.3)] * 2, st.just(0.0), st.floats(-0.5, 0.5)).map(np.array)
PHASE = np.linspace(0.0, 1.0, 2001)


@given(start=poses, target=poses)
def test_the_path_starts_and_ends_at_rest(start: np.ndarray, target: np.ndarray) -> None:
    path = swing_path(PHASE, start, target, CLEARANCE)
    np.testing.assert_allclose(path[[0, -1]], [start, target], atol=1e-12)
    speed = np.gradient(path, PHASE, axis=0)
    assert np.abs(speed[[0, -1]]).max() < 5e-3
    # Between its ends, except for the height.
    low, high = np.minimum(start, target), np.maximum(start, target)
    flat = [0, 1, 3]
    assert (path[:, flat] >= low[flat] - 1e-12).all() and (path[:, flat] <= high[flat] + 1e-12).all()


def test_the_greatest_height_is_the_clearance() -> None:
    path = swing_path(PHASE, np.zeros(4), np.array([0.1, 0.0, 0.0, 0.2]), CLEARANCE)
    assert path[:, 2].max() == pytest.approx(CLEARANCE)
    assert path[:, 2].min() >= 0.0
    assert PHASE[path[:, 2].argmax()] == pytest.approx(0.5)


def test_a_step_up_lands_at_the_height_of_its_target() -> None:
    path = swing_path(PHASE, np.zeros(4), np.array([0.1, 0.0, 0.03, 0.0]), CLEARANCE)
    assert path[-1, 2] == pytest.approx(0.03)
    assert path[:, 2].max() > 0.03


def test_peak_acceleration_is_an_upper_bound() -> None:
    distance, seconds = 0.1, 0.4
    path = swing_path(PHASE, np.zeros(4), np.array([distance, 0.0, 0.0, 0.0]), CLEARANCE)[:, 0]
    t = PHASE * seconds
    peak = np.abs(np.gradient(np.gradient(path, t), t)[2:-2]).max()
    assert peak <= PEAK_ACCELERATION * distance / seconds**2 * 1.001
    assert peak > 0.7 * PEAK_ACCELERATION * distance / seconds**2


def test_the_path_is_constant_beyond_its_ends() -> None:
    start, target = np.array([0.0, 0.1, 0.0, 0.0]), np.array([0.1, 0.1, 0.0, 0.3])
    np.testing.assert_array_equal(
        swing_path(np.array([-1.0, 2.0]), start, target, CLEARANCE),
        swing_path(np.array([0.0, 1.0]), start, target, CLEARANCE),
    )
