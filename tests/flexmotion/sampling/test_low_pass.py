"""A window is low-passed without a jump from the frames before it."""

from __future__ import annotations

import numpy as np
import pytest

from flexmotion.sampling.low_pass import continued

FPS, CUTOFF = 30.0, 6.0
TIME = np.arange(44) / FPS


@pytest.mark.parametrize("power", [0, 1, 2])
def test_even_motion_stays(power: int) -> None:
    signal = TIME[:, None] ** power * [1.0, -2.0]
    assert continued(signal[12:], signal[:12], FPS, CUTOFF) == pytest.approx(signal[12:], abs=1e-9)


@pytest.mark.parametrize(("frequency", "least", "most"), [(1.0, 0.99, 1.01), (6.0, 0.4, 0.6), (12.0, 0.0, 0.06)])
def test_what_is_left_of_a_frequency(frequency: float, least: float, most: float) -> None:
    time = np.arange(200) / FPS
    wave = np.sin(2 * np.pi * frequency * time)
    found = continued(wave[12:], wave[:12], FPS, CUTOFF)[20:-20]
    left = np.linalg.norm(found) / np.linalg.norm(wave[32:-20])
    assert least <= left <= most


def test_a_jump_at_the_join_becomes_smooth() -> None:
    signal = np.where(np.arange(44) < 12, 0.0, 0.01)
    found = np.concatenate([signal[:12], continued(signal[12:], signal[:12], FPS, CUTOFF)])
    assert np.abs(np.diff(found, n=3)).max() < 0.4 * np.abs(np.diff(signal, n=3)).max()
    assert found[-1] == pytest.approx(0.01, abs=5e-4)


def test_above_half_the_frame_rate_nothing_is_removed() -> None:
    noise = np.random.default_rng(0).normal(size=(20, 3))
    np.testing.assert_array_equal(continued(noise, noise[:1], 10.0, CUTOFF), noise)


def test_one_known_frame_is_enough() -> None:
    level = np.ones((20, 2))
    assert continued(level, level[:1], FPS, CUTOFF) == pytest.approx(level)
