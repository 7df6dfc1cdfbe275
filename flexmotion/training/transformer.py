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
        query, key, value = self.mix(self.norm_attention(tokens)).chunk(3, dim=-1)
        tokens = tokens + self.out(attention(query, key, value, self.heads))
        return tokens + self.narrow(nn.functional.gelu(self.widen(self.norm_forward(tokens)), approximate="tanh"))


def attention(query: Tensor, key: Tensor, value: Tensor, heads: int) -> Tensor:
    """Attention of several heads, each of a part of the width, (N, L, width) each -> (N, L, width).

    onnxruntime has it as one operator. Exported as its parts it is a dozen for a layer, whose calls take longer than
    what they compute.
    """
    samples, length, width = query.shape
    if torch.onnx.is_in_onnx_export():
        exported: Tensor = torch.onnx.ops.symbolic(
            "com.microsoft::MultiHeadAttention",
            (query, key, value),
            {"num_heads": heads},
            dtype=query.dtype,
            shape=query.shape,
            version=1,
        )
        return exported
    query, key, value = (
        one.view(samples, length, heads, width // heads).transpose(1, 2) for one in (query, key, value)
    )
    found = nn.functional.scaled_dot_product_attention(query, key, value)
    return found.transpose(1, 2).reshape(samples, length, width)


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
