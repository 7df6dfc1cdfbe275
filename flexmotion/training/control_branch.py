"""`ControlBranch`: a copy of a denoiser's layers that is fed with constraints, and adds to what the layers make.

A ControlNet (Zhang et al., ICCV 2023) on a model of few steps in a latent space (Dai et al., MotionLCM, ECCV 2024). The
last map of every copied layer is zero at first, so that the model is unchanged before training.
"""

from __future__ import annotations

from copy import deepcopy

import torch
from torch import Tensor, nn

from flexmotion.configs.errors import ConfigError
from flexmotion.configs.model import ControlConfig, Window
from flexmotion.features.constraint_layout import ConstraintLayout
from flexmotion.features.layout import Layout
from flexmotion.training.denoiser import Denoiser
from flexmotion.training.transformer import parameter

SPREAD = 0.05
"""Initial spread of the weights by which constraints are read."""


class ControlBranch(nn.Module):
    """Copied layers, the tokens of constraints that they see beside those of the denoiser, and maps back.

    Args:
        denoiser: whose layers are copied.
        config: how many.
        window: frames.
        layout: of the features.

    Raises:
        ConfigError: a window is no whole number of patches.
    """

    scales: Tensor

    def __init__(self, denoiser: Denoiser, config: ControlConfig, window: Window, layout: Layout) -> None:
        super().__init__()
        if window.future % config.patch:
            raise ConfigError(f"control.patch is {config.patch}, expected a divisor of window.future {window.future}")
        columns, width = ConstraintLayout(layout), denoiser.width
        self.patch = config.patch
        self.register_buffer("scales", torch.tensor(columns.scales), persistent=False)
        inputs = 2 * config.patch * columns.size
        first = nn.Linear(inputs, width)
        # Most constraints are few numbers among thousands of zeros, which the usual spread would hardly let be seen.
        nn.init.normal_(first.weight, std=SPREAD)
        self.read = nn.Sequential(first, nn.SiLU(), nn.Linear(width, width))
        self.place = parameter(1, window.future // config.patch, width)
        copied = [deepcopy(layer) for _, layer in zip(range(config.layers), denoiser.stack.layers, strict=False)]
        self.layers = nn.ModuleList(copied).requires_grad_(True)
        self.leave = nn.ModuleList(_zero(width) for _ in copied)

    def forward(self, values: Tensor, mask: Tensor) -> Tensor:
        """Tokens of constraints, (N, W / patch, width).

        Args:
            values: in the units of `ConstraintLayout`, (N, W, C).
            mask: 1 where a value is asked, else 0, (N, W, C).
        """
        frames = torch.cat([mask * values / self.scales, mask], dim=-1)
        found: Tensor = self.read(frames.unflatten(1, (-1, self.patch)).flatten(2)) + self.place
        return found


class ConstrainedDenoiser(nn.Module):
    """A denoiser with a control branch.

    Args:
        denoiser: distilled; kept as it is.
        branch: trained on it.
    """

    def __init__(self, denoiser: Denoiser, branch: ControlBranch) -> None:
        super().__init__()
        self.denoiser, self.branch = denoiser, branch

    def forward(
        self,
        noisy: Tensor,
        time: Tensor,
        history: Tensor,
        sentence: Tensor,
        velocity: Tensor,
        manner: Tensor,
        present: Tensor,
        guidance: Tensor,
        values: Tensor,
        mask: Tensor,
    ) -> Tensor:
        """Clean latent, normalised, (N, latent); see `Denoiser.forward` and `ControlBranch.forward`."""
        tokens = self.denoiser.tokens(noisy, time, history, sentence, velocity, manner, present, guidance)
        both = torch.cat([tokens, self.branch(values, mask)], dim=1)
        copies = list(zip(self.branch.layers, self.branch.leave, strict=True))
        for number, layer in enumerate(self.denoiser.stack.layers):
            tokens = layer(tokens)
            if number < len(copies):
                copied, leave = copies[number]
                both = copied(both)
                tokens = tokens + leave(both[:, : tokens.shape[1]])
        found: Tensor = self.denoiser.leave(self.denoiser.stack.norm(tokens)[:, 0])
        return found


def _zero(width: int) -> nn.Linear:
    layer = nn.Linear(width, width)
    nn.init.zeros_(layer.weight)
    nn.init.zeros_(layer.bias)
    return layer
