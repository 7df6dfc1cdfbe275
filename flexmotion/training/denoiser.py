"""`Denoiser`: the network of the latent diffusion."""

from __future__ import annotations

import torch
from torch import Tensor, nn

from flexmotion.configs.model import DiffusionConfig, Window
from flexmotion.features.layout import Layout
from flexmotion.training.autoencoder import Patches
from flexmotion.training.transformer import Stack, parameter, sinusoids

COMMAND = 3
"""Commanded velocity: forward, left [leg/s], turning [rad/s]."""

GUIDANCE_UNIT = 100.0
"""Factor of guidance scales before their sines and cosines are taken."""


class Denoiser(nn.Module):
    """Estimates the clean latent from a noisy one, its time, history, sentence and commanded velocity.

    Tokens: latent, time, sentence, velocity, history. An absent sentence or velocity has a learned token. A guided
    network (the student of a distillation) has the guidance scale as an input.

    Args:
        config: of the diffusion.
        window: frames.
        layout: features.
        latent: size of the latent.
        guided: whether the guidance scale is an input.
    """

    latent_mean: Tensor
    latent_spread: Tensor
    sentence_mean: Tensor
    sentence_spread: Tensor

    def __init__(
        self, config: DiffusionConfig, window: Window, layout: Layout, latent: int, *, guided: bool = False
    ) -> None:
        super().__init__()
        width = config.denoiser.width
        self.width = width
        self.register_buffer("latent_mean", torch.zeros(latent))
        self.register_buffer("latent_spread", torch.ones(latent))
        # Embeddings of left and right differ by a few hundredths: without scaling they take long to be told apart.
        self.register_buffer("sentence_mean", torch.zeros(config.text))
        self.register_buffer("sentence_spread", torch.ones(config.text))
        self.enter, self.leave = nn.Linear(latent, width), nn.Linear(width, latent)
        self.time = nn.Sequential(nn.Linear(width, width), nn.SiLU(), nn.Linear(width, width))
        self.guidance = _zero_at_first(width) if guided else None
        self.sentence, self.no_sentence = nn.Linear(config.text, width), parameter(width)
        self.velocity = nn.Sequential(nn.Linear(COMMAND, width), nn.SiLU(), nn.Linear(width, width))
        self.no_velocity = parameter(width)
        past = window.history // window.patch
        self.recall = Patches(layout.kinematic, window.patch, width) if past else None
        self.place = parameter(1, 4 + past, width)
        self.stack = Stack(config.denoiser)

    def forward(
        self,
        noisy: Tensor,
        time: Tensor,
        history: Tensor,
        sentence: Tensor,
        velocity: Tensor,
        present: Tensor,
        guidance: Tensor | None = None,
    ) -> Tensor:
        """Clean latent, normalised, (N, latent).

        Args:
            noisy: normalised latent with noise, (N, latent).
            time: of the noise schedule, (N,), 0 is nearly clean.
            history: normalised features, (N, H, F).
            sentence: embedding, (N, text).
            velocity: commanded, forward, left, turning, (N, 3) [leg/s, leg/s, rad/s].
            present: whether sentence and velocity are given, (N, 2), 1 or 0.
            guidance: scale, (N,); guided networks only.
        """
        when = self.time(sinusoids(time, self.width))
        if self.guidance is not None and guidance is not None:
            when = when + self.guidance(sinusoids(guidance * GUIDANCE_UNIT, self.width))
        has_sentence, has_velocity = present[:, :1], present[:, 1:]
        sentence = (sentence - self.sentence_mean) / self.sentence_spread
        tokens = torch.stack(
            [
                self.enter(noisy),
                when,
                has_sentence * self.sentence(sentence) + (1 - has_sentence) * self.no_sentence,
                has_velocity * self.velocity(velocity) + (1 - has_velocity) * self.no_velocity,
            ],
            dim=1,
        )
        if self.recall is not None:
            tokens = torch.cat([tokens, self.recall(history)], dim=1)
        return self.leave(self.stack(tokens + self.place)[:, 0])


def _zero_at_first(width: int) -> nn.Sequential:
    """A network whose output is zero before training: a student starts as its teacher without guidance."""
    last = nn.Linear(width, width)
    nn.init.zeros_(last.weight)
    nn.init.zeros_(last.bias)
    return nn.Sequential(nn.Linear(width, width), nn.SiLU(), last)
