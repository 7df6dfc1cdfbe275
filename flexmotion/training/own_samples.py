"""`OwnSamples`: keeps a model as it was on motion that it samples itself, where its training set is not at hand.

Prior preservation without data (Ruiz et al., DreamBooth, CVPR 2023): windows are sampled from the model before it is
changed, and the changed one is to estimate the same clean latents as the model before (Hinton et al., 2015).
"""

from __future__ import annotations

from collections.abc import Callable
from copy import deepcopy
from functools import partial

import numpy as np
import torch
from torch import Tensor, nn

from flexmotion.configs.model import DiffusionConfig
from flexmotion.text.manners import NORMAL, manner_wordings
from flexmotion.text.phrases import wordings
from flexmotion.training.conditions import Conditions
from flexmotion.training.diffusion_task import DiffusionTask
from flexmotion.training.distillation_task import guided
from flexmotion.training.draws import normal, uniform
from flexmotion.training.examples import Example
from flexmotion.training.manner_conditions import mean_embedding
from flexmotion.training.set_summary import SetSummary

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


NORMAL_SHARE = 0.5
"""Share of the windows in the normal manner, where the model knows it."""


class OwnSamples:
    """Loss on what a model sampled before it is changed; see `stage.Task`, and `Examples` of that for a student.

    Args:
        model: whose network is kept as it is now.
        encode: sentence to embedding.
        known: kinds of motion and manners that it was trained on, and a human who stands.
        seed: of all draws.
        settings: that it was trained by: conditions are dropped as often, since guidance needs both.
    """

    def __init__(
        self,
        model: DiffusionTask,
        encode: Callable[[str], np.ndarray],
        known: SetSummary,
        seed: int,
        settings: DiffusionConfig,
    ) -> None:
        self._model, self._known, self._seed, self._settings = model, known, seed, settings
        self._kinds = {kind: mean_embedding(wordings(kind), encode) for kind in known.kinds}
        self._manners = {name: mean_embedding(manner_wordings(name), encode) for name in known.manners}
        self._device = model.processes.device
        self.network: nn.Module = model.network
        self._teacher = deepcopy(model.network).eval().requires_grad_(False)
        self._batch = model.config.stages.diffusion.batch
        self._histories, self._latents, self._conditions = self._roll_outs()
        self._training = np.flatnonzero(np.arange(len(self._latents)) % ROLL_OUTS % HELD_OUT)

    def _roll_outs(self) -> tuple[Tensor, Tensor, Conditions]:
        """Histories (N, H, F), normalised latents (N, L) and conditions, window by window."""
        model, diffusion = self._model, self._model.config.diffusion
        rest = self._known.statistics.normalise(self._known.rest)[len(self._known.rest) - model.config.window.history :]
        history = torch.from_numpy(rest)[None].expand(ROLL_OUTS, -1, -1).to(self._device)
        scales = torch.tensor([[diffusion.guidance, diffusion.manner_guidance]], device=self._device)
        histories, latents, asked = [], [], []
        for window in range(WINDOWS):
            conditions = self._draw(np.random.default_rng((self._seed, 51, window)))
            noise = normal((self._seed, 52, window), (ROLL_OUTS, model.autoencoder.latent)).to(self._device)
            estimate = partial(self._guided, history=history, conditions=conditions, scales=scales)
            with torch.no_grad():
                latent = model.noise.denoised(noise, STEPS, estimate)
                decoded = model.decode(history, latent)
            histories.append(history)
            latents.append(latent)
            asked.append(conditions)
            history = decoded[:, decoded.shape[1] - history.shape[1] :]
        row = np.concatenate([one.row for one in asked])
        both = (
            torch.cat([getattr(one, name) for one in asked]) for name in ("sentence", "velocity", "manner", "present")
        )
        return torch.cat(histories), torch.cat(latents), Conditions(row, *both)

    def _guided(self, noisy: Tensor, time: Tensor, history: Tensor, conditions: Conditions, scales: Tensor) -> Tensor:
        """The model's estimate under guidance, before it is changed."""
        each = (conditions, conditions.without_manner(), conditions.unconditional())
        full, any_manner, none = (self._estimate(self._teacher, noisy, time, history, one) for one in each)
        return guided(full, any_manner, none, scales)

    def _draw(self, rng: np.random.Generator) -> Conditions:
        """Conditions of one window of each roll-out, as requests are heard: by the mean of a kind's wordings."""
        names, manners = rng.choice(self._known.kinds, ROLL_OUTS), self._manners
        said = np.where(
            rng.random(ROLL_OUTS) < NORMAL_SHARE, NORMAL, rng.choice([*self._known.manners, NORMAL], ROLL_OUTS)
        )
        width = self._model.config.diffusion.text
        manner = np.stack([manners.get(str(name), np.zeros(width)) for name in said])
        share = rng.uniform(-0.5, 1.0, (ROLL_OUTS, 3)) * (rng.random((ROLL_OUTS, 1)) < COMMANDED)
        share[:, 1:] *= rng.choice([-1.0, 1.0], (ROLL_OUTS, 2))
        has_manner = np.isin(said, list(manners))
        present = np.stack([np.ones(ROLL_OUTS), share.any(axis=1), has_manner], axis=1)
        arrays = (np.stack([self._kinds[str(name)] for name in names]), share * FASTEST, manner, present)
        tensors = (torch.from_numpy(np.asarray(values, np.float32)) for values in arrays)
        return Conditions(np.zeros(ROLL_OUTS, np.intp), *tensors).to(self._device)

    def draw(self, key: tuple[int, ...], size: int) -> Example:
        """See `Examples`. Histories get no noise: they have the errors of the model's own samples."""
        rows = torch.from_numpy(np.random.default_rng((*key, 0)).choice(self._training, size))
        return Example(self._histories[rows], self._latents[rows], self._asked(rows, (*key, 1)))

    def losses(self, step: int) -> tuple[Tensor, dict[str, Tensor]]:
        """See `stage.Task`."""
        chosen = np.random.default_rng((self._seed, 53, step)).choice(self._training, self._batch)
        loss = self._loss(torch.from_numpy(chosen), (self._seed, 54, step))
        return loss, {"kept": loss}

    def validate(self) -> dict[str, float]:
        """Loss on held-out roll-outs, always the same."""
        rows = np.flatnonzero(np.arange(len(self._latents)) % ROLL_OUTS % HELD_OUT == 0)
        return {"loss": float(self._loss(torch.from_numpy(rows), (self._seed, 55)))}

    def _loss(self, rows: Tensor, key: tuple[int, ...]) -> Tensor:
        """Mean square difference of the two networks' estimates; conditions are dropped as in training."""
        diffusion, history, latent = self._model.config.diffusion, self._histories[rows], self._latents[rows]
        count = len(rows)
        time = (uniform((*key, 0), (count,)) * diffusion.steps).long().to(self._device)
        noise = normal((*key, 1), tuple(latent.shape)).to(self._device)
        noisy = self._model.noise.add_noise(latent, noise, time)
        inputs = (noisy, time, history, self._asked(rows, (*key, 2)))
        with torch.no_grad():
            expected = self._estimate(self._teacher, *inputs)
        return (self._estimate(self.network, *inputs) - expected).square().mean()

    def _asked(self, rows: Tensor, key: tuple[int, ...]) -> Conditions:
        """Conditions of windows, some of them dropped as in training."""
        diffusion, known = self._settings, self._conditions
        dropped = torch.tensor([diffusion.drop_text, diffusion.drop_velocity, diffusion.drop_manner])
        kept = (uniform(key, (len(rows), 3)) >= dropped).float()
        kept[:, 2] *= kept[:, 0]  # a manner is never asked for without a sentence
        present = known.present[rows] * kept.to(self._device)
        return Conditions(
            known.row[rows.numpy()], known.sentence[rows], known.velocity[rows], known.manner[rows], present
        )

    @staticmethod
    def _estimate(network: nn.Module, noisy: Tensor, time: Tensor, history: Tensor, conditions: Conditions) -> Tensor:
        request = (conditions.sentence, conditions.velocity, conditions.manner, conditions.present)
        clean: Tensor = network(noisy, time, history, *request)
        return clean
