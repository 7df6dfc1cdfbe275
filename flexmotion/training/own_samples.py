"""`OwnSamples`: keeps a model as it was on motion that it samples itself, where its training set is not at hand.

Prior preservation without data (Ruiz et al., DreamBooth, CVPR 2023): windows are sampled from the model before it is
changed, and the changed one is to estimate the same clean latents as the model before (Hinton et al., 2015).
"""

from __future__ import annotations

from collections.abc import Callable
from copy import deepcopy

import numpy as np
import torch
from torch import Tensor, nn

from flexmotion.text.phrases import kinds, wordings
from flexmotion.training.diffusion_task import DiffusionTask
from flexmotion.training.draws import normal, uniform

ROLL_OUTS, WINDOWS = 192, 8
"""Roll-outs from standing, and windows of each."""

HELD_OUT = 8
"""One roll-out of so many is for the validation."""

STEPS = 8
"""DDIM steps of a sample."""

FASTEST = (1.8, 0.4, 1.2)
"""Commanded velocities are drawn up to this, backward to half of it [leg/s, leg/s, rad/s]."""

COMMANDED = 0.4
"""Share of the windows with a commanded velocity."""


class OwnSamples:
    """Loss on what a model sampled before it is changed; see `stage.Task`.

    Args:
        model: whose network is kept as it is now.
        encode: sentence to embedding.
        rest: history of a human who stands, normalised, (H, F).
        seed: of all draws.
    """

    def __init__(self, model: DiffusionTask, encode: Callable[[str], np.ndarray], rest: np.ndarray, seed: int) -> None:
        self._model, self._encode, self._seed, self._device = model, encode, seed, model.processes.device
        self.network: nn.Module = model.network
        self._teacher = deepcopy(model.network).eval().requires_grad_(False)
        self._batch = model.config.stages.diffusion.batch
        drop = model.config.diffusion
        self._drop = torch.tensor([drop.drop_text, drop.drop_velocity])
        history = torch.from_numpy(rest[len(rest) - model.config.window.history :]).float()
        self._histories, self._latents, self._sentences, self._velocities = self._roll_outs(history)
        self._present = (self._velocities.abs().sum(dim=1) > 0).float()

    def _roll_outs(self, rest: Tensor) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        """Histories (N, H, F), normalised latents (N, L), sentences (N, D) and velocities (N, 3), window by window."""
        model, diffusion = self._model, self._model.config.diffusion
        known = [(kind, wording) for kind in kinds() for wording in wordings(kind)]
        rng = np.random.default_rng((self._seed, 51))
        history = rest[None].expand(ROLL_OUTS, -1, -1).to(self._device)
        times = torch.linspace(diffusion.steps - 1, 0, STEPS + 1).round().long().tolist()[:-1]
        parts = []
        for window in range(WINDOWS):
            # Kinds are drawn alike, however many wordings they have.
            names = rng.choice(kinds(), ROLL_OUTS)
            texts = [str(rng.choice([text for kind, text in known if kind == name])) for name in names]
            sentence = torch.from_numpy(np.stack([self._encode(text) for text in texts])).float().to(self._device)
            share = rng.uniform(-0.5, 1.0, (ROLL_OUTS, 3)) * (rng.random((ROLL_OUTS, 1)) < COMMANDED)
            share[:, 1:] *= rng.choice([-1.0, 1.0], (ROLL_OUTS, 2))
            velocity = torch.from_numpy(share * FASTEST).float().to(self._device)
            given = (velocity.abs().sum(dim=1) > 0).float()
            present = torch.stack([torch.ones_like(given), given], dim=1)
            noisy = normal((self._seed, 52, window), (ROLL_OUTS, model.autoencoder.latent)).to(self._device)
            with torch.no_grad():
                for now, earlier in zip(times, [*times[1:], -1], strict=True):
                    time, target = (torch.full((ROLL_OUTS,), at, device=self._device) for at in (now, earlier))
                    asked, free = (
                        self._teacher(noisy, time, history, sentence, velocity, shown)
                        for shown in (present, torch.zeros_like(present))
                    )
                    noisy = model.noise.step(noisy, free + diffusion.guidance * (asked - free), time, target)
                decoded = model.decode(history, noisy)
            parts.append((history, noisy, sentence, velocity))
            history = decoded[:, decoded.shape[1] - history.shape[1] :]
        return tuple(torch.cat([part[at] for part in parts]) for at in range(4))  # type: ignore[return-value]

    def losses(self, step: int) -> tuple[Tensor, dict[str, Tensor]]:
        """See `stage.Task`."""
        rows = np.flatnonzero(np.arange(len(self._latents)) % ROLL_OUTS % HELD_OUT)
        chosen = np.random.default_rng((self._seed, 53, step)).choice(rows, self._batch)
        loss = self._loss(torch.from_numpy(chosen), (self._seed, 54, step))
        return loss, {"kept": loss}

    def validate(self) -> dict[str, float]:
        """Loss on held-out roll-outs, always the same."""
        rows = np.flatnonzero(np.arange(len(self._latents)) % ROLL_OUTS % HELD_OUT == 0)
        return {"loss": float(self._loss(torch.from_numpy(rows), (self._seed, 55)))}

    def _loss(self, rows: Tensor, key: tuple[int, ...]) -> Tensor:
        latent, count, device = self._latents[rows], len(rows), self._device
        time = (uniform((*key, 0), (count,)) * self._model.config.diffusion.steps).long().to(device)
        noise = normal((*key, 1), tuple(latent.shape)).to(device)
        noisy = self._model.noise.add_noise(latent, noise, time)
        present = torch.stack([torch.ones_like(self._present[rows]), self._present[rows]], dim=1)
        present = present * (uniform((*key, 2), (count, 2)) >= self._drop).to(device)
        inputs = (noisy, time, self._histories[rows], self._sentences[rows], self._velocities[rows], present)
        with torch.no_grad():
            expected = self._teacher(*inputs)
        found: Tensor = self.network(*inputs)
        return (found - expected).square().mean()
