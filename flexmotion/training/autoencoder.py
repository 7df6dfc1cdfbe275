"""`Autoencoder`: a window of all modalities to one latent vector and, given the history, back."""

from __future__ import annotations

from contextlib import AbstractContextManager, nullcontext

import torch
from torch import Tensor, nn

from flexmotion.configs.model import AutoencoderConfig, Window
from flexmotion.features.layout import Layout
from flexmotion.training.dynamics_head import DynamicsHead
from flexmotion.training.principal_components import Components, kinematic_columns, straight_columns
from flexmotion.training.transformer import Stack, parameter

QUIET = -5.0
"""Initial logarithm of the latent's variance."""


class Patches(nn.Module):
    """Frames to tokens: each modality has its own linear map of `patch` frames; a token is their sum."""

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
    """Tokens to frames: each modality has its own linear map from the token."""

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
    columns: Tensor

    def __init__(self, config: AutoencoderConfig, window: Window, layout: Layout) -> None:
        super().__init__()
        self.latent = config.latent
        self._kinematic = tuple(layout.kinematic)
        self.past, ahead = window.history // window.patch, window.future // window.patch
        width = config.encoder.width
        self.read = Patches(layout.blocks, window.patch, width)
        self.encoder_place = parameter(1, self.past + ahead, width)
        self.summary = parameter(1, 1, width)
        self.encoder = Stack(config.encoder)
        self.distribution = nn.Linear(width, 2 * config.latent)
        # The decoder takes long to use a latent that is mostly noise at first.
        nn.init.constant_(self.distribution.bias[config.latent :], QUIET)
        width = config.decoder.width
        self.recall = Patches(layout.kinematic, window.patch, width) if self.past else None
        self.unfold = nn.Linear(config.latent, width)
        self.decoder_place = parameter(1, 1 + self.past + ahead, width)
        self.decoder = Stack(config.decoder)
        self.write = Frames(layout.blocks, window.patch, width)
        self.dynamics = DynamicsHead(width, layout, loads=config.loads)
        self.register_load_state_dict_pre_hook(_without_dynamics)
        # A pose changes little in a second: the decoder learns the difference from the last known frame.
        self.persistence = nn.Parameter(torch.ones(layout.size)) if self.past else None
        known = torch.zeros(layout.size)
        for columns in layout.kinematic.values():
            known[columns] = 1.0
        self.register_buffer("known", known, persistent=False)
        self.register_buffer("columns", kinematic_columns(layout), persistent=False)
        self.read_straight: nn.Linear | None = None
        self.write_straight: nn.Linear | None = None
        if config.shortcut:
            # Not trained: a step of Adam that suits a network is far too large for a sum over 5,000 inputs.
            width = window.future * len(straight_columns(layout))
            self.read_straight = nn.Linear(window.future * len(self.columns), config.latent).requires_grad_(False)
            self.write_straight = nn.Linear(config.latent, width).requires_grad_(False)

    def begin_with(self, components: Components) -> None:
        """Set the linear maps to the principal components, and the output of the networks beside them to zero."""
        assert self.read_straight is not None and self.write_straight is not None
        with torch.no_grad():
            self.read_straight.weight.copy_(components.read)
            self.read_straight.bias.copy_(components.read_bias)
            self.write_straight.weight.copy_(components.write)
            self.write_straight.bias.copy_(components.write_bias)
            self.distribution.weight.zero_()
            for value in self.write.parameters():
                value.zero_()

    def motion(self) -> dict[str, nn.Parameter]:
        """Parameters of latents and motion, by name; the others are of estimated forces."""
        return {name: value for name, value in self.named_parameters() if not self._beside_motion(name)}

    def hold_motion(self) -> None:
        """Freeze the parameters of latents and decoded motion."""
        for value in self.motion().values():
            value.requires_grad_(False)

    def _beside_motion(self, name: str) -> bool:
        parts = name.split(".")
        return parts[0] == "dynamics" or (parts[:2] == ["write", "maps"] and parts[2] not in self._kinematic)

    def encode(self, history: Tensor, future: Tensor) -> tuple[Tensor, Tensor]:
        """Mean and logarithm of the variance of the latent, (N, latent) each, of normalised features."""
        tokens = self.read(torch.cat([history, future], dim=1)) + self.encoder_place
        tokens = torch.cat([self.summary.expand(len(tokens), -1, -1), tokens], dim=1)
        mean, spread = self.distribution(self.encoder(tokens)[:, 0]).chunk(2, dim=-1)
        if self.read_straight is not None:
            ahead = future - self.known * history[:, -1:] if self.recall is not None else future
            with _in_full_precision(ahead.device):
                mean = mean.float() + self.read_straight(ahead[..., self.columns].flatten(1))
        return mean, spread.clamp(-12.0, 4.0)

    def decode(self, history: Tensor, latent: Tensor, loads: Tensor | None = None) -> Tensor:
        """Future (N, W, F), normalised.

        Args:
            history: normalised, (N, H, F).
            latent: (N, latent).
            loads: external forces of the future, see `DynamicsHead`; None for none.
        """
        unfolded = self.unfold(latent)[:, None]
        ahead = self.decoder_place.shape[1] - 1 - self.past
        parts = [unfolded, unfolded.expand(-1, ahead, -1)]
        if self.recall is not None:
            parts.insert(1, self.recall(history))
        tokens = self.decoder(torch.cat(parts, dim=1) + self.decoder_place)
        with _in_full_precision(latent.device):
            frames: Tensor = self.write(tokens[:, 1 + self.past :].float())
            if self.write_straight is not None:
                straight = self.write_straight(latent.float()).unflatten(1, (frames.shape[1], -1))
                frames = frames + nn.functional.pad(straight, (0, frames.shape[2] - straight.shape[2]))
            if self.persistence is not None:
                frames = frames + self.persistence * self.known * history[:, -1:]
            return self.dynamics(history, frames, loads)

    def forward(
        self, history: Tensor, future: Tensor, noise: Tensor, loads: Tensor | None = None
    ) -> tuple[Tensor, Tensor, Tensor]:
        """Decoded future, mean and logarithm of the variance; `noise` is standard normal, (N, latent)."""
        mean, spread = self.encode(history, future)
        return self.decode(history, mean + torch.exp(0.5 * spread) * noise, loads), mean, spread


def _in_full_precision(device: torch.device) -> AbstractContextManager[object]:
    """Context without autocast: frames are differentiated twice, and in bfloat16 their accelerations are noise."""
    mixed = torch.is_autocast_enabled(device.type)
    return torch.autocast(device.type, enabled=False) if mixed else nullcontext()


def _without_dynamics(network: nn.Module, weights: dict[str, Tensor], prefix: str, *_: object) -> None:
    """Complete weights from before the dynamics head with those of a head that adds nothing."""
    for name, value in network.state_dict(prefix=prefix).items():
        if name.startswith(f"{prefix}dynamics."):
            weights.setdefault(name, value)
