"""Inputs and outputs of the networks."""

from __future__ import annotations

import pytest

torch = pytest.importorskip("torch", reason="training needs the extra 'train'")

from flexmotion.configs.model import load_model_config  # noqa: E402
from flexmotion.features.layout import Layout  # noqa: E402
from flexmotion.training.autoencoder import Autoencoder  # noqa: E402
from flexmotion.training.denoiser import Denoiser  # noqa: E402


@pytest.mark.parametrize("name", ["stream", "paper"])
def test_shapes(name: str) -> None:
    config = load_model_config(name)
    window, layout = config.window, Layout(config.window.fps, 290)
    network = Autoencoder(config.autoencoder, window, layout)
    history, future = torch.randn(2, window.history, layout.size), torch.randn(2, window.future, layout.size)
    decoded, mean, spread = network(history, future, torch.randn(2, config.autoencoder.latent))
    assert decoded.shape == future.shape
    assert mean.shape == spread.shape == (2, config.autoencoder.latent)


def test_forces_of_the_history_have_no_effect() -> None:
    """They are unknown at run time: a history with other torques and forces must give the same motion."""
    config = load_model_config("stream")
    window, layout = config.window, Layout(30.0, 290)
    autoencoder = Autoencoder(config.autoencoder, window, layout).eval()
    denoiser = Denoiser(config.diffusion, window, layout, config.autoencoder.latent).eval()
    history = torch.randn(1, window.history, layout.size)
    other = history.clone()
    other[..., layout.blocks["torques"].start :] = 7.0
    latent, present = torch.randn(1, config.autoencoder.latent), torch.ones(1, 3)
    sentence, manner = torch.randn(2, 1, config.diffusion.text)
    velocity, time = torch.randn(1, 3), torch.tensor([500])
    with torch.no_grad():
        assert torch.equal(autoencoder.decode(history, latent), autoencoder.decode(other, latent))
        first, second = (denoiser(latent, time, past, sentence, velocity, manner, present) for past in (history, other))
    assert torch.equal(first, second)


def test_frames_have_full_precision() -> None:
    """Regression: in bfloat16, as on a GPU, rounding gave decoded motion accelerations as large as the true ones."""
    config = load_model_config("stream")
    window, layout = config.window, Layout(30.0, 0)
    autoencoder = Autoencoder(config.autoencoder, window, layout).eval()
    history, latent = torch.randn(1, window.history, layout.size), torch.randn(1, config.autoencoder.latent)
    with torch.no_grad(), torch.autocast("cpu", torch.bfloat16):
        frames = autoencoder.decode(history, latent)
    assert frames.dtype is torch.float32
    assert not torch.equal(frames, frames.bfloat16().float())


def test_absent_conditions_have_no_effect() -> None:
    config = load_model_config("stream")
    denoiser = Denoiser(config.diffusion, config.window, Layout(30.0, 290), 128)
    history, latent = torch.randn(2, 8, Layout(30.0, 290).size), torch.randn(1, 128).expand(2, -1)
    history = history[:1].expand(2, -1, -1)
    time, absent = torch.tensor([500, 500]), torch.zeros(2, 3)
    with torch.no_grad():
        found = denoiser(latent, time, history, torch.randn(2, 384), torch.randn(2, 3), torch.randn(2, 384), absent)
    torch.testing.assert_close(found[0], found[1])
