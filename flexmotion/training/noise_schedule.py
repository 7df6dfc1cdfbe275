"""`NoiseSchedule`: how much of a latent is left at each time of the diffusion."""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from diffusers import DDPMScheduler
from torch import Tensor


class NoiseSchedule:
    """The cosine schedule (Nichol and Dhariwal, ICML 2021); time 0 is nearly clean, the last nearly noise.

    Args:
        steps: times there are.
        device: of the table.
    """

    def __init__(self, steps: int, device: torch.device | None = None) -> None:
        scheduler: Any = DDPMScheduler(num_train_timesteps=steps, beta_schedule="squaredcos_cap_v2")
        table = np.asarray(scheduler.alphas_cumprod, np.float32)
        self.steps = steps
        self.kept: Tensor = torch.from_numpy(table).to(device or torch.device("cpu"))

    def add_noise(self, clean: Tensor, noise: Tensor, time: Tensor) -> Tensor:
        """Latents with noise, (N, L), at times (N,)."""
        kept = self.kept[time][:, None]
        return kept.sqrt() * clean + (1 - kept).sqrt() * noise

    def step(self, noisy: Tensor, clean: Tensor, time: Tensor, earlier: Tensor) -> Tensor:
        """One step of DDIM without fresh noise (Song et al., ICLR 2021) from `time` to `earlier`, (N,) each.

        `clean` is what the network takes `noisy` for; an `earlier` below 0 is clean.
        """
        kept = self.kept[time][:, None]
        target = torch.where(earlier[:, None] < 0, torch.ones_like(kept), self.kept[earlier.clamp(min=0)][:, None])
        noise = (noisy - kept.sqrt() * clean) / (1 - kept).sqrt().clamp(min=1e-6)
        return target.sqrt() * clean + (1 - target).sqrt() * noise
