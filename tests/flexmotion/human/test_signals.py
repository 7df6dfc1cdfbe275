"""Filters and interpolation."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from flexmotion.human.signals import (
    fill,
    low_pass,
    resample_quaternions,
    resample_rotations,
    resample_signal,
)


def sine(fps: float, hertz: float, seconds: float = 4.0) -> np.ndarray:
    return np.sin(2 * np.pi * hertz * np.arange(round(seconds * fps) + 1) / fps)[:, None]


@pytest.mark.parametrize(("fps", "new"), [(120, 30), (60, 25), (30, 50), (20, 30)])
def test_slow_motion_survives(fps, new):
    result = resample_signal(sine(fps, 1.5), fps, new)
    assert len(result) == len(sine(new, 1.5))
    np.testing.assert_allclose(result, sine(new, 1.5), atol=0.02)


def test_frequencies_above_the_new_rate_are_removed_without_aliasing():
    result = resample_signal(sine(120, 28.0), 120, 30)
    assert np.abs(result[10:-10]).max() < 0.02


def test_low_pass_keeps_a_line_to_its_ends():
    line = np.linspace(0, 1, 50)[:, None]
    np.testing.assert_allclose(low_pass(line, 30, 6), line, atol=1e-3)


def test_short_signals():
    assert len(resample_signal(np.zeros((1, 3)), 120, 30)) == 1
    np.testing.assert_allclose(resample_signal(np.ones((5, 2)), 120, 30), np.ones((2, 2)), atol=1e-9)


def test_quaternions_are_resampled_across_changes_of_sign():
    yaw = np.linspace(0, 4 * np.pi, 121)
    turning = Rotation.from_euler("z", yaw[:, None])
    flipped = turning.as_quat() * np.where(np.arange(121) % 3 == 0, -1.0, 1.0)[:, None]
    result = resample_quaternions(flipped, 30, 60)
    assert np.linalg.norm(np.diff(result, axis=0), axis=1).max() < 0.1
    expected = Rotation.from_euler("z", np.linspace(0, 4 * np.pi, 241)[:, None])
    assert (Rotation.from_quat(result) * expected.inv()).magnitude().max() < 1e-3
    matrices = resample_rotations(turning.as_matrix(), 30, 60)
    assert (Rotation.from_matrix(matrices) * expected.inv()).magnitude().max() < 1e-3


def test_fill_interpolates_across_a_gap():
    values, weight = np.zeros((60, 1)), np.zeros(60)
    values[:20], weight[:20] = 1.0, 1.0
    values[40:], weight[40:] = 3.0, 1.0
    filled = fill(values, weight, sigma=4.0)
    assert filled[5, 0] == pytest.approx(1.0, abs=0.01)
    assert filled[55, 0] == pytest.approx(3.0, abs=0.01)
    assert (np.diff(filled[:, 0]) > -1e-3).all()
