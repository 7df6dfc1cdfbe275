"""`Autoencoder`: a window of all modalities to one latent vector and, with the history at hand, back."""

from __future__ import annotations

import torch
from torch import Tensor, nn

from configs.model import AutoencoderConfig, Window
from flexmotion.features.layout import Layout
from flexmotion.training.transformer import Stack, parameter

QUIET = -5.0
"""Logarithm of the latent's variance at first."""


class Patches(nn.Module):
    """Frames to tokens: each modality has its own map of `patch` frames into the token, and these add up."""

    def __init__(self, blocks: dict[str, slice], patch: int, width: int) -> None:
        super().__init__()
        self.patch, self.blocks = patch, blocks
        self.maps = nn.ModuleDict(
            {name: nn.Linear(patch * (cut.stop - cut.start), width) for name, cut in blocks.items()}
        )

    def forward(self, frames: Tensor) -> Tensor:
        """(N, T, F) -> (N, T / patch, width)."""
        tokens: Tensor | None = None
        for name, cut in self.blocks.items():
            grouped = frames[..., cut].unflatten(1, (-1, self.patch)).flatten(2)
            part = self.maps[name](grouped)
            tokens = part if tokens is None else tokens + part
        assert tokens is not None
        return tokens


class Frames(nn.Module):
    """Tokens to frames: each modality is read from the token by its own map."""

    def __init__(self, blocks: dict[str, slice], patch: int, width: int) -> None:
        super().__init__()
        self.patch = patch
        self.maps = nn.ModuleDict(
            {name: nn.Linear(width, patch * (cut.stop - cut.start)) for name, cut in blocks.items()}
        )

    def forward(self, tokens: Tensor) -> Tensor:
        """(N, L, width) -> (N, L * patch, F)."""
        parts = [head(tokens).unflatten(-1, (self.patch, -1)).flatten(1, 2) for head in self.maps.values()]
        return torch.cat(parts, dim=-1)


class Autoencoder(nn.Module):
    """Variational autoencoder of windows.

    Args:
        config: widths and depths.
        window: frames.
        layout: features.
    """

    known: Tensor

    def __init__(self, config: AutoencoderConfig, window: Window, layout: Layout) -> None:
        super().__init__()
        self.latent = config.latent
        self.past, ahead = window.history // window.patch, window.future // window.patch
        width = config.encoder.width
        self.read = Patches(layout.blocks, window.patch, width)
        self.encoder_place = parameter(1, self.past + ahead, width)
        self.summary = parameter(1, 1, width)
        self.encoder = Stack(config.encoder)
        self.distribution = nn.Linear(width, 2 * config.latent)
        # A latent that begins as mostly noise takes long to be noticed by the decoder.
        nn.init.constant_(self.distribution.bias[config.latent :], QUIET)
        width = config.decoder.width
        self.recall = Patches(layout.kinematic, window.patch, width) if self.past else None
        self.unfold = nn.Linear(config.latent, width)
        self.decoder_place = parameter(1, 1 + self.past + ahead, width)
        self.decoder = Stack(config.decoder)
        self.write = Frames(layout.blocks, window.patch, width)
        # A pose changes little in a second: decoding begins with the last known frame and learns the difference.
        self.persistence = nn.Parameter(torch.ones(layout.size)) if self.past else None
        known = torch.zeros(layout.size)
        for columns in layout.kinematic.values():
            known[columns] = 1.0
        self.register_buffer("known", known, persistent=False)

    def encode(self, history: Tensor, future: Tensor) -> tuple[Tensor, Tensor]:
        """Mean and logarithm of the variance of the latent, (N, latent) each, of normalised features."""
        tokens = self.read(torch.cat([history, future], dim=1)) + self.encoder_place
        tokens = torch.cat([self.summary.expand(len(tokens), -1, -1), tokens], dim=1)
        mean, spread = self.distribution(self.encoder(tokens)[:, 0]).chunk(2, dim=-1)
        return mean, spread.clamp(-12.0, 4.0)

    def decode(self, history: Tensor, latent: Tensor) -> Tensor:
        """The future, (N, W, F), normalised, from the history (N, H, F) and a latent (N, latent)."""
        unfolded = self.unfold(latent)[:, None]
        ahead = self.decoder_place.shape[1] - 1 - self.past
        parts = [unfolded, unfolded.expand(-1, ahead, -1)]
        if self.recall is not None:
            parts.insert(1, self.recall(history))
        tokens = self.decoder(torch.cat(parts, dim=1) + self.decoder_place)
        frames: Tensor = self.write(tokens[:, 1 + self.past :])
        return frames if self.persistence is None else frames + self.persistence * self.known * history[:, -1:]

    def forward(self, history: Tensor, future: Tensor, noise: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Decoded future, mean and logarithm of the variance; `noise` is standard normal, (N, latent)."""
        mean, spread = self.encode(history, future)
        return self.decode(history, mean + torch.exp(0.5 * spread) * noise), mean, spread
