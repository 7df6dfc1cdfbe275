"""Recursive filters: those of scipy, without its import."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import signal as reference

from flexmotion.human.filters import butterworth, recursive

FEED, BACK = (0.2, 0.1, 0.05), (-0.9, 0.3)


@pytest.mark.parametrize("frames", [0, 1, 2, 3, 200])
def test_a_filter_is_that_of_scipy(frames: int) -> None:
    random = np.random.default_rng(1)
    noise, state = random.normal(size=(frames, 2, 3)), random.normal(size=(2, 2, 3))
    expected, _ = reference.lfilter(FEED, (1.0, *BACK), noise, axis=0, zi=state)
    np.testing.assert_allclose(recursive(FEED, BACK, noise, state), expected, atol=1e-12)
    np.testing.assert_allclose(recursive(FEED, BACK, noise), reference.lfilter(FEED, (1.0, *BACK), noise, axis=0))


def test_a_filter_of_first_order_has_one_state() -> None:
    steps = np.random.default_rng(2).normal(size=(60, 2))
    expected, _ = reference.lfilter([0.1], [1.0, -0.9], steps, axis=0, zi=np.ones((1, 2)))
    np.testing.assert_allclose(recursive([0.1], [-0.9], steps, np.ones((1, 2))), expected)


def test_one_signal_alone_and_its_input_is_left_as_it_is() -> None:
    step = np.ones(40)
    np.testing.assert_allclose(recursive(FEED, BACK, step), reference.lfilter(FEED, (1.0, *BACK), step))
    assert (step == 1.0).all()


@pytest.mark.parametrize("cutoff", [0.5, 20.0, 60.0])
def test_butterworth_is_that_of_scipy(cutoff: float) -> None:
    numerator, denominator = reference.butter(2, cutoff, fs=125.0)
    feed, back = butterworth(cutoff, 125.0)
    np.testing.assert_allclose(feed, numerator, rtol=1e-9)
    np.testing.assert_allclose(back, denominator[1:], rtol=1e-9)


@pytest.mark.parametrize(("cutoff", "fps"), [(20.0, 40.0), (20.0, 30.0), (0.0, 100.0), (-1.0, 100.0)])
def test_a_cut_off_beyond_half_the_rate_is_refused(cutoff: float, fps: float) -> None:
    """Its poles lay outside the unit circle: accelerations grew along the plan."""
    with pytest.raises(ValueError, match="expected between 0 and"):
        butterworth(cutoff, fps)
