"""Principal components of windows: the fixed linear part of the autoencoder."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from flexmotion.configs.model import LossWeights
from flexmotion.features.layout import ACTIVATIONS, KINEMATIC, Layout
from flexmotion.training.window_set import WindowSet

WINDOWS, WINDOWS_EACH = 8192, 64
"""Windows of the training split that are decomposed; at most this many per component."""

CHUNK = 512

ITERATIONS = 4
"""Iterations of the randomised decomposition (Halko et al., SIAM Review 53(2), 2011; `torch.svd_lowrank`)."""


@dataclass(frozen=True)
class Components:
    """Linear maps between a window's difference from the last known frame and L uncorrelated numbers of unit variance.

    Attributes:
        read, read_bias: map from the kinematic blocks, (L, W * K) and (L,).
        write, write_bias: map to all features but the muscle activations, (W * G, L) and (W * G,).
    """

    read: Tensor
    read_bias: Tensor
    write: Tensor
    write_bias: Tensor


def kinematic_columns(layout: Layout) -> Tensor:
    """Columns of the blocks that a latent is read from, (K,)."""
    blocks = layout.kinematic
    return torch.cat([torch.arange(blocks[name].start, blocks[name].stop) for name in KINEMATIC])


def straight_columns(layout: Layout) -> Tensor:
    """Columns that are decoded linearly, (G,): all but the muscle activations, which are many and not linear."""
    blocks = layout.blocks
    return torch.cat([torch.arange(blocks[name].start, blocks[name].stop) for name in blocks if name != ACTIVATIONS])


def principal_components(
    windows: WindowSet, layout: Layout, weights: LossWeights, latent: int, known: Tensor, seed: int
) -> Components:
    """Principal components of the kinematic blocks, weighted as in the loss.

    Torques and forces are decoded from them by linear regression.

    Args:
        windows: of the training split.
        layout: of their features.
        weights: of the blocks; a block's weight is shared by its columns.
        latent: L, how many components.
        known: 1 for features that are decoded as differences from the last known frame, else 0, (F,).
        seed: of the draws.
    """
    columns, straight = kinematic_columns(layout), straight_columns(layout)
    scale = torch.cat(
        [torch.full((cut.stop - cut.start,), (weights.blocks.get(name, 0.0) / (cut.stop - cut.start)) ** 0.5)
         for name, cut in layout.kinematic.items()]
    )  # fmt: skip

    def differences(number: int) -> Tensor:
        drawn = windows.draw((seed, 3, number), CHUNK)
        last = drawn.history[:, -1:] if drawn.history.shape[1] else torch.zeros(1)
        return drawn.future - known * last

    chunks = range(max(min(WINDOWS, WINDOWS_EACH * latent) // CHUNK, 1))
    seen = torch.cat([(differences(number)[..., columns] * scale).flatten(1) for number in chunks])
    mean = seen.mean(dim=0)
    seen -= mean
    torch.manual_seed(seed)
    left, spread, right = torch.svd_lowrank(seen, q=min(latent, *seen.shape), niter=ITERATIONS)
    numbers = left * len(seen) ** 0.5  # of unit variance
    weight = right / spread.clamp(min=1e-6 * float(spread[0])) * len(seen) ** 0.5
    total, product = torch.zeros(()), torch.zeros(())
    for number in chunks:
        frames = differences(number)[..., straight].flatten(1)
        total = total + frames.sum(dim=0)
        product = product + frames.T @ numbers[number * CHUNK : (number + 1) * CHUNK]
    read = torch.zeros(latent, seen.shape[1])
    write = torch.zeros(len(total), latent)
    count = numbers.shape[1]
    read[:count] = (weight * scale.repeat(windows.window.future)[:, None]).T
    write[:, :count] = product / len(seen)
    return Components(read, -(mean @ weight @ torch.eye(count, latent)), write, total / len(seen))
