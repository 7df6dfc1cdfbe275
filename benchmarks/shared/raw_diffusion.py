"""Diffusion of frames, without a latent: the baseline of `model/baselines`.

The architecture of MDM (Tevet et al., ICLR 2023): one token a frame, and an encoder of Transformer layers over them.
What is asked, what windows are trained on, loss, guidance and delivery are those of the latent diffusion.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from flexmotion.bundles.bundle import Bundle
from flexmotion.configs.model import DiffusionConfig, Window
from flexmotion.features.layout import Layout
from flexmotion.sampling.ddim import denoised
from flexmotion.sampling.guidance import guided
from flexmotion.sampling.sampler import Condition, Sampler
from flexmotion.training.denoiser import Denoiser
from flexmotion.training.diffusion_task import DiffusionTask
from flexmotion.training.processes import Processes
from flexmotion.training.run import Run
from flexmotion.training.transformer import parameter

Float32 = NDArray[np.float32]


class Frames(nn.Module):
    """Takes the place of the autoencoder: the latent of a window is its frames.

    Args:
        frames: of a window.
        features: of a frame.
    """

    def __init__(self, frames: int, features: int) -> None:
        super().__init__()
        self._shape, self.latent = (frames, features), frames * features

    def encode(self, history: Tensor, future: Tensor) -> tuple[Tensor, Tensor]:
        """Frames of windows (N, W, F) as latents (N, W x F), and their spread."""
        flat = future.flatten(1)
        return flat, torch.zeros_like(flat)

    def decode(self, history: Tensor, latent: Tensor) -> Tensor:
        """Frames of latents, (N, W, F)."""
        return latent.unflatten(1, self._shape)


class FrameDenoiser(Denoiser):
    """A denoiser of frames: a token for each of them, beside those of what is asked."""

    def __init__(self, config: DiffusionConfig, window: Window, layout: Layout, latent: int) -> None:
        super().__init__(config, window, layout, latent)
        self._frames = window.future
        self.enter, self.leave = nn.Linear(layout.size, self.width), nn.Linear(self.width, layout.size)
        self.frame_place = parameter(1, window.future, self.width)

    def forward(
        self,
        noisy: Tensor,
        time: Tensor,
        history: Tensor,
        sentence: Tensor,
        velocity: Tensor,
        manner: Tensor,
        present: Tensor,
        guidance: Tensor | None = None,
    ) -> Tensor:
        """Clean frames, normalised, (N, W x F); see `Denoiser.forward`."""
        frames = noisy.unflatten(1, (self._frames, -1))
        entered = self.enter(frames) + self.frame_place
        # The first token of the latent denoiser is its latent; here it is the mean of the frames.
        asked = self.tokens(frames.mean(dim=1), time, history, sentence, velocity, manner, present)
        found: Tensor = self.stack(torch.cat([entered, asked], dim=1))[:, : self._frames]
        return self.leave(found).flatten(1)


class RawTask(DiffusionTask):
    """Training of the baseline; see `stage.Task`.

    Args:
        run: with the features and the sentence encoder.
        encode: sentence to embedding.
    """

    def __init__(self, run: Run, encode: Callable[[str], np.ndarray]) -> None:
        store = run.store()
        frames = Frames(run.config.window.future, store.layout.size)
        super().__init__(
            run.config,
            store,
            frames,  # type: ignore[arg-type]  # all that a task asks of an autoencoder
            encode,
            run.seed,
            Processes(),
            architecture=FrameDenoiser,
        )

    def _measure_latents(self) -> None:
        """Features are normalised as they are: those that hardly change must not be amplified."""


class RawSampler(Sampler):
    """A sampler of the baseline; words, delivery and human are a bundle's.

    Args:
        bundle: of the latent model.
        network: trained.
        run: that it was trained in.
        steps: of the diffusion.
    """

    def __init__(self, bundle: Bundle, network: FrameDenoiser, run: Run, steps: int) -> None:
        super().__init__(bundle, steps, unjudged=True)
        self._network = network.eval()
        self._scales = (run.config.diffusion.guidance, run.config.diffusion.manner_guidance)

    def _latent(self, remembered: Float32, condition: Condition, seed: int) -> Float32:
        inputs, network = self._inputs, self._network
        inputs["history"][:] = self._statistics.normalise(remembered)
        condition = self.meant(condition)
        self.requests.write(condition, remembered, inputs)
        asked = inputs["present"][:1]
        present = np.concatenate([asked, asked * [1, 1, 0], 0 * asked]).astype(np.float32)
        history, sentence, velocity, manner = (
            torch.from_numpy(np.repeat(inputs[name][:1], 3, axis=0))
            for name in ("history", "sentence", "velocity", "manner")
        )
        noisy = np.random.default_rng(seed).standard_normal((1, self.future * self.layout.size), np.float32)

        def estimate(noisy: Float32, time: int) -> Float32:
            with torch.no_grad():
                rows, when = torch.from_numpy(np.repeat(noisy, 3, axis=0)), torch.full((3,), time)
                found = network(rows, when, history, sentence, velocity, manner, torch.from_numpy(present))
            return guided(found.numpy(), *self._scales)

        return denoised(noisy, self._kept, self.steps, estimate)

    def _frames(self, latent: Float32) -> Float32:
        spread, mean = self._network.latent_spread.numpy(), self._network.latent_mean.numpy()
        return self._statistics.restore((latent * spread + mean).reshape(self.future, self.layout.size))
