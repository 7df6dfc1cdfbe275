"""`NoiseSchedule`: share of a latent that is left at each time of the diffusion."""

from __future__ import annotations

import math
from collections.abc import Callable
from itertools import pairwise

import torch
from torch import Tensor

OFFSET, MAX_BETA = 0.008, 0.999
"""Of the cosine schedule: noise at time 0, and the most that one step may add."""


class NoiseSchedule:
    """The cosine schedule (Nichol and Dhariwal, ICML 2021): time 0 is nearly clean, the last nearly noise.

    Args:
        steps: number of times.
        device: of the table.

    Attributes:
        kept: share of the latent's variance that is left at each time (ᾱ in the literature), (steps,).
    """

    def __init__(self, steps: int, device: torch.device | None = None) -> None:
        self.steps = steps
        left = [math.cos((at / steps + OFFSET) / (1.0 + OFFSET) * math.pi / 2) ** 2 for at in range(steps + 1)]
        beta = torch.tensor([min(1.0 - after / before, MAX_BETA) for before, after in pairwise(left)])
        self.kept: Tensor = torch.cumprod(1.0 - beta, dim=0).to(device or torch.device("cpu"))

    def add_noise(self, clean: Tensor, noise: Tensor, time: Tensor) -> Tensor:
        """Noisy latents, (N, L), at times (N,)."""
        kept = self.kept[time][:, None]
        return kept.sqrt() * clean + (1 - kept).sqrt() * noise

    def step(self, noisy: Tensor, clean: Tensor, time: Tensor, earlier: Tensor) -> Tensor:
        """One deterministic step of DDIM (Song et al., ICLR 2021) from `time` to `earlier`, (N,) each.

        `clean` is the network's estimate from `noisy`; at an `earlier` below 0 the result is clean.
        """
        kept = self.kept[time][:, None]
        target = torch.where(earlier[:, None] < 0, torch.ones_like(kept), self.kept[earlier.clamp(min=0)][:, None])
        noise = (noisy - kept.sqrt() * clean) / (1 - kept).sqrt().clamp(min=1e-6)
        return target.sqrt() * clean + (1 - target).sqrt() * noise

    def times(self, steps: int) -> Tensor:
        """The times at which so many steps evaluate the network, spread evenly, the latest first."""
        return torch.linspace(self.steps - 1, 0, steps + 1).round().long()[:-1]

    def denoised(self, noisy: Tensor, steps: int, estimate: Callable[[Tensor, Tensor], Tensor]) -> Tensor:
        """The latents that noise leads to, (N, L).

        Args:
            noisy: the noise, (N, L).
            steps: of DDIM, spread evenly over the times.
            estimate: the network: the clean latents of noisy ones at times (N,).
        """
        times = self.times(steps).tolist()
        for now, earlier in zip(times, [*times[1:], -1], strict=True):
            time, target = (torch.full((len(noisy),), at, device=noisy.device) for at in (now, earlier))
            noisy = self.step(noisy, estimate(noisy, time).float(), time, target)
        return noisy
