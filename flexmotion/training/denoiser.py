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
    """Estimates the clean latent from a noisy one, its time, history, sentence, commanded velocity and manner.

    Tokens: latent, time, sentence, velocity, manner, history. An absent sentence, velocity or manner has a learned
    token. A guided network (the student of a distillation) has the guidance scales as an input.

    Args:
        config: of the diffusion.
        window: frames.
        layout: features.
        latent: size of the latent.
        guided: whether the guidance scales are an input.
    """

    latent_mean: Tensor
    latent_spread: Tensor
    sentence_mean: Tensor
    sentence_spread: Tensor
    manner_mean: Tensor
    manner_spread: Tensor

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
        self.register_buffer("manner_mean", torch.zeros(config.text))
        self.register_buffer("manner_spread", torch.ones(config.text))
        self.enter, self.leave = nn.Linear(latent, width), nn.Linear(width, latent)
        self.time = nn.Sequential(nn.Linear(width, width), nn.SiLU(), nn.Linear(width, width))
        self.guidance = _zero_at_first(width) if guided else None
        self.manner_guidance = _zero_at_first(width) if guided else None
        self.sentence, self.no_sentence = nn.Linear(config.text, width), parameter(width)
        self.velocity = nn.Sequential(nn.Linear(COMMAND, width), nn.SiLU(), nn.Linear(width, width))
        self.no_velocity = parameter(width)
        self.manner, self.no_manner = nn.Linear(config.text, width), parameter(width)
        past = window.history // window.patch
        self.recall = Patches(layout.kinematic, window.patch, width) if past else None
        self.place = parameter(1, 5 + past, width)
        self.stack = Stack(config.denoiser)

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
        """Clean latent, normalised, (N, latent).

        Args:
            noisy: normalised latent with noise, (N, latent).
            time: of the noise schedule, (N,), 0 is nearly clean.
            history: normalised features, (N, H, F).
            sentence: embedding, (N, text).
            velocity: commanded, forward, left, turning, (N, 3) [leg/s, leg/s, rad/s].
            manner: embedding, (N, text).
            present: whether sentence, velocity and manner are given, (N, 3), 1 or 0.
            guidance: scales of the request and of its manner, (N, 2); guided networks only.
        """
        tokens = self.tokens(noisy, time, history, sentence, velocity, manner, present, guidance)
        return self.leave(self.stack(tokens)[:, 0])

    def tokens(
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
        """Tokens of the inputs of `forward`, with their places, (N, 5 + history / patch, width)."""
        when = self.time(sinusoids(time, self.width))
        if self.guidance is not None and self.manner_guidance is not None and guidance is not None:
            scales = guidance * GUIDANCE_UNIT
            when = when + self.guidance(sinusoids(scales[:, 0], self.width))
            when = when + self.manner_guidance(sinusoids(scales[:, 1], self.width))
        has_sentence, has_velocity, has_manner = present[:, :1], present[:, 1:2], present[:, 2:]
        sentence = (sentence - self.sentence_mean) / self.sentence_spread
        manner = (manner - self.manner_mean) / self.manner_spread
        tokens = torch.stack(
            [
                self.enter(noisy),
                when,
                has_sentence * self.sentence(sentence) + (1 - has_sentence) * self.no_sentence,
                has_velocity * self.velocity(velocity) + (1 - has_velocity) * self.no_velocity,
                has_manner * self.manner(manner) + (1 - has_manner) * self.no_manner,
            ],
            dim=1,
        )
        if self.recall is not None:
            tokens = torch.cat([tokens, self.recall(history)], dim=1)
        return tokens + self.place


def _zero_at_first(width: int) -> nn.Sequential:
    """A network whose output is zero before training: a student starts as its teacher without guidance."""
    last = nn.Linear(width, width)
    nn.init.zeros_(last.weight)
    nn.init.zeros_(last.bias)
    return nn.Sequential(nn.Linear(width, width), nn.SiLU(), last)
