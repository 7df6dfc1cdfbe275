"""From noise to a latent: what the network is shown, and where it leads."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from flexmotion.sampling.ddim import denoised

KEPT = np.cos(np.linspace(0.02, 0.98, 50) * np.pi / 2).astype(np.float32) ** 2
"""A cosine schedule of fifty times."""


@given(seed=st.integers(0, 99), steps=st.integers(1, 50))
def test_a_network_that_knows_the_latent_leads_to_it_in_any_number_of_steps(seed: int, steps: int) -> None:
    rng = np.random.default_rng(seed)
    latent, noisy = rng.standard_normal((2, 1, 8)).astype(np.float32)
    times: list[int] = []

    def estimate(shown: np.ndarray, time: int) -> np.ndarray:
        # Between latent and noise, in the shares of that time.
        expected = noisy if not times else np.sqrt(KEPT[time]) * latent + np.sqrt(1 - KEPT[time]) * implied
        assert shown == pytest.approx(expected, abs=1e-2)
        times.append(time)
        return latent

    implied = (noisy - np.sqrt(KEPT[-1]) * latent) / np.sqrt(1 - KEPT[-1])
    assert denoised(noisy, KEPT, steps, estimate) == pytest.approx(latent, abs=1e-5)
    assert len(times) == steps and times[0] == 49 and times == sorted(times, reverse=True)


def test_the_last_step_hands_on_what_the_network_found() -> None:
    found = iter(np.float32([[[1.0]], [[2.0]], [[3.0]]]))
    assert denoised(np.float32([[0.3]]), KEPT, 3, lambda noisy, time: next(found)) == pytest.approx(3.0)
