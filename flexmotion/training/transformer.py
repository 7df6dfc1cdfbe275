"""Transformer layers, as small as they export well: pre-norm, no dropout."""

from __future__ import annotations

import math

import torch
from torch import Tensor, nn

from flexmotion.configs.model import Transformer


class Layer(nn.Module):
    """Self-attention and a feed-forward part, each with a shortcut."""

    def __init__(self, config: Transformer) -> None:
        super().__init__()
        width = config.width
        self.heads = config.heads
        self.norm_attention, self.norm_forward = nn.LayerNorm(width), nn.LayerNorm(width)
        self.mix, self.out = nn.Linear(width, 3 * width), nn.Linear(width, width)
        self.widen, self.narrow = nn.Linear(width, config.expansion * width), nn.Linear(config.expansion * width, width)

    def forward(self, tokens: Tensor) -> Tensor:
        """(N, L, width) -> the same."""
        samples, length, width = tokens.shape
        mixed = self.mix(self.norm_attention(tokens)).view(samples, length, 3, self.heads, width // self.heads)
        query, key, value = mixed.permute(2, 0, 3, 1, 4)
        found = nn.functional.scaled_dot_product_attention(query, key, value)
        tokens = tokens + self.out(found.transpose(1, 2).reshape(samples, length, width))
        return tokens + self.narrow(nn.functional.gelu(self.widen(self.norm_forward(tokens)), approximate="tanh"))


class Stack(nn.Module):
    """Layers one after the other, then a norm."""

    def __init__(self, config: Transformer) -> None:
        super().__init__()
        self.layers = nn.ModuleList(Layer(config) for _ in range(config.layers))
        self.norm = nn.LayerNorm(config.width)

    def forward(self, tokens: Tensor) -> Tensor:
        """(N, L, width) -> the same."""
        for layer in self.layers:
            tokens = layer(tokens)
        return self.norm(tokens)


def parameter(*shape: int) -> nn.Parameter:
    """A learned vector, small at first."""
    return nn.Parameter(0.02 * torch.randn(*shape))


def sinusoids(place: Tensor, width: int) -> Tensor:
    """Sines and cosines of numbers at `width / 2` frequencies, (N,) -> (N, width)."""
    rate = torch.exp(-math.log(10_000.0) * torch.arange(width // 2, device=place.device) / (width // 2))
    angle = place[:, None].float() * rate
    return torch.cat([torch.cos(angle), torch.sin(angle)], dim=-1)
