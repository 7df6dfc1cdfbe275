"""`Evaluator`: encoders of motion and of sentences into one space, to measure generated motion."""

from __future__ import annotations

import torch
from torch import Tensor, nn

from flexmotion.configs.model import EvaluatorConfig, Window
from flexmotion.features.layout import Layout
from flexmotion.training.autoencoder import Patches
from flexmotion.training.transformer import Stack, parameter


class Evaluator(nn.Module):
    """A Transformer over windows, a small network over sentence embeddings.

    Args:
        config: sizes.
        window: frames; the future is embedded, without its history.
        layout: features.
        text: width of sentence embeddings.
    """

    def __init__(self, config: EvaluatorConfig, window: Window, layout: Layout, text: int) -> None:
        super().__init__()
        width = config.motion.width
        self.read = Patches(layout.kinematic, window.patch, width)
        self.summary = parameter(1, 1, width)
        self.place = parameter(1, 1 + window.future // window.patch, width)
        self.stack = Stack(config.motion)
        self.out = nn.Linear(width, config.width)
        self.said = nn.Sequential(nn.Linear(text, width), nn.GELU(), nn.Linear(width, config.width))

    def motion(self, future: Tensor) -> Tensor:
        """Embeddings of unit length of normalised windows, (N, W, F) -> (N, width)."""
        tokens = torch.cat([self.summary.expand(len(future), -1, -1), self.read(future)], dim=1)
        return nn.functional.normalize(self.out(self.stack(tokens + self.place)[:, 0]), dim=-1)

    def sentence(self, embedding: Tensor) -> Tensor:
        """Embeddings of unit length of sentence embeddings, (N, D) -> (N, width)."""
        return nn.functional.normalize(self.said(embedding), dim=-1)
