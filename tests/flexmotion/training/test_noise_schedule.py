"""The noise schedule against the one that the shipped model was trained with, and its steps against theory."""

from __future__ import annotations

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="training needs the extra 'train'")

from flexmotion.bundles.bundle import Bundle  # noqa: E402
from flexmotion.bundles.shipped import FOLDER  # noqa: E402
from flexmotion.training.noise_schedule import NoiseSchedule  # noqa: E402


def test_the_schedule_is_that_of_the_shipped_model() -> None:
    """Its table was made by `DDPMScheduler` of diffusers with `squaredcos_cap_v2`."""
    np.testing.assert_array_equal(NoiseSchedule(1000).kept.numpy(), Bundle(FOLDER).kept)


@pytest.mark.parametrize("steps", [10, 1000])
def test_nearly_clean_at_first_and_nearly_noise_at_last(steps: int) -> None:
    kept = NoiseSchedule(steps).kept
    assert len(kept) == steps and (kept.diff() < 0).all()
    assert kept[0] > 0.97 and 0.0 < kept[-1] < 1e-4


@pytest.mark.parametrize(("now", "earlier"), [(999, 900), (500, 400), (100, 0)])
def test_a_step_with_the_true_latent_stays_on_its_path(now: int, earlier: int) -> None:
    """DDIM: the noise of a sample stays the same, only its share changes."""
    generator = torch.Generator().manual_seed(0)
    schedule = NoiseSchedule(1000)
    clean, noise = torch.randn(2, 3, 16, generator=generator)
    before, after = (schedule.add_noise(clean, noise, torch.full((3,), time)) for time in (now, earlier))
    found = schedule.step(before, clean, torch.full((3,), now), torch.full((3,), earlier))
    torch.testing.assert_close(found, after, atol=1e-4, rtol=1e-4)


def test_each_sample_has_its_own_times_and_below_zero_is_clean() -> None:
    generator = torch.Generator().manual_seed(1)
    schedule = NoiseSchedule(100)
    clean, noise = torch.randn(2, 2, 16, generator=generator)
    time, earlier = torch.tensor([80, 30]), torch.tensor([60, -1])
    found = schedule.step(schedule.add_noise(clean, noise, time), clean, time, earlier)
    torch.testing.assert_close(found[0], schedule.add_noise(clean, noise, earlier.clamp(min=0))[0])
    torch.testing.assert_close(found[1], clean[1])
