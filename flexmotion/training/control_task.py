"""The control branch's stage: constraints get into a distilled model, with a loss in motion space.

The distilled model and the decoder are kept. The branch is trained to reach windows of clips of which some values are
told: the estimate's latent is compared with the window's, and what the frozen decoder makes of it with the told values
(Dai et al., MotionLCM, ECCV 2024), places of the body by forward kinematics of the decoded rotations.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor, nn

from flexmotion.configs.model import ModelConfig
from flexmotion.features.constraint_layout import PLACES, TORQUE_LIMITS, ConstraintLayout, window_values
from flexmotion.training.conditions import Conditions
from flexmotion.training.constraint_draws import DRAWS, draw_constraints
from flexmotion.training.control_branch import ConstrainedDenoiser, ControlBranch
from flexmotion.training.denoiser import Denoiser
from flexmotion.training.diffusion_task import DiffusionTask
from flexmotion.training.draws import normal, uniform
from flexmotion.training.kinematics import points, pose, segments
from flexmotion.training.windows import Windows

VALIDATION = 192
"""Windows of the validation, always the same."""

LATE = 0.5
"""Times of the noise schedule are uniform numbers to this power: a few steps of sampling are late ones."""

HUBER = 10.0
"""Tolerances of a value from which on its loss is linear: far off, a constraint must not outweigh all others."""


@dataclass(frozen=True)
class Asked:
    """Windows with what is asked of them: values and mask, (N, W, C), and of each the number of its kind, (N,)."""

    windows: Windows
    conditions: Conditions
    latent: Tensor
    values: Tensor
    mask: Tensor
    kinds: np.ndarray


class ControlTask:
    """Training of the branch; see `stage.Task`.

    Args:
        config: of the model.
        teacher: trained diffusion, for its windows, latents and decoder; kept as it is.
        student: distilled; kept as it is.
        seed: of all draws.
    """

    def __init__(self, config: ModelConfig, teacher: DiffusionTask, student: Denoiser, seed: int) -> None:
        torch.manual_seed(seed)
        self.config, self.teacher, self.seed = config, teacher, seed
        device, store = teacher.processes.device, teacher.training.store
        self.layout, self.constraints = store.layout, ConstraintLayout(store.layout)
        student = student.to(device).eval().requires_grad_(False)
        branch = ControlBranch(student, config.control, config.window, store.layout).to(device)
        self.network: nn.Module = branch
        self._denoiser = ConstrainedDenoiser(student, branch)
        distillation = config.distillation
        self._grid = torch.linspace(0, config.diffusion.steps - 1, distillation.grid).round().long()
        self._mean, self._spread = (
            torch.from_numpy(value).to(device) for value in (store.statistics.mean, store.statistics.spread)
        )
        self._weight = 1.0 / torch.tensor(self.constraints.tolerances, device=device)
        held_out = teacher.held_out.draw((seed, 41), VALIDATION).to(device)
        self._held_out = self._ask(held_out, (seed, 42))

    def losses(self, step: int) -> tuple[Tensor, dict[str, Tensor]]:
        """See `stage.Task`."""
        teacher, batch = self.teacher, self.config.stages.control.batch
        key = (self.seed, 43, step, teacher.processes.rank)
        asked = self._ask(teacher.windows((*key, 0), batch, teacher.roll_out), (*key, 1))
        place = (uniform((*key, 2), (batch,)) ** LATE * self.config.distillation.grid).long()
        found = self._estimate(asked, self._grid[place], (*key, 3))
        latent = torch.nn.functional.huber_loss(found, asked.latent, delta=self.config.distillation.huber)
        kept = self._kept(asked, found).mean()
        return kept + self.config.control.latent * latent, {"kept": kept, "latent": latent}

    def validate(self) -> dict[str, float]:
        """Loss at the latest time, from which sampling begins, and the error of each kind over its tolerance."""
        asked = self._held_out
        found = self._estimate(asked, torch.full((VALIDATION,), int(self._grid[-1])), (self.seed, 44))
        latent = float(torch.nn.functional.huber_loss(found, asked.latent, delta=self.config.distillation.huber))
        kept = self._kept(asked, found).cpu().numpy()
        figures = {"loss": float(kept.mean()) + self.config.control.latent * latent, "latent": latent}
        for number, name in enumerate(DRAWS):
            own = kept[asked.kinds == number]
            if name != "nothing" and len(own):
                figures[name] = float(own.mean())
        return figures

    def _ask(self, windows: Windows, key: tuple[int, ...]) -> Asked:
        """Windows with their latents, conditions, and what is asked of them."""
        teacher = self.teacher
        true = self._restored(windows.future)
        values = window_values(true, self.layout, torch).cpu().numpy()
        past = windows.history.shape[1]
        known = (windows.good[:, past:] & windows.mask).cpu().numpy()
        rng = np.random.default_rng((*key, 0))
        asked, mask, kinds = draw_constraints(rng, self.constraints, values, known)
        device = teacher.processes.device
        return Asked(
            windows=windows,
            conditions=teacher.training.describe(windows, (*key, 1)),
            latent=teacher.normalised(teacher.training.encode(windows.history, windows.future)),
            values=torch.from_numpy(asked).to(device),
            mask=torch.from_numpy(mask.astype(np.float32)).to(device),
            kinds=kinds,
        )

    def _estimate(self, asked: Asked, time: Tensor, key: tuple[int, ...]) -> Tensor:
        """The model's estimate of the clean latents from noisy ones at some times, (N, latent)."""
        teacher, distillation, conditions = self.teacher, self.config.distillation, asked.conditions
        device, size = teacher.processes.device, len(asked.latent)
        low, high = distillation.guidance_low, distillation.guidance_high
        guidance = (low + (high - low) * uniform((*key, 0), (size, 2))).to(device)
        noise = normal((*key, 1), tuple(asked.latent.shape)).to(device)
        time = time.to(device)
        noisy = teacher.noise.add_noise(asked.latent, noise, time)
        request = (conditions.sentence, conditions.velocity, conditions.manner, conditions.present)
        with teacher.processes.mixed_precision():
            found: Tensor = self._denoiser(
                noisy, time, asked.windows.history, *request, guidance, asked.values, asked.mask
            )
        return found.float()

    def _kept(self, asked: Asked, latent: Tensor) -> Tensor:
        """Mean error of the asked values of each window, over `HUBER` tolerances, (N,); 0 where nothing is asked."""
        windows = asked.windows
        features = self._restored(self.teacher.decode(windows.history, latent).float())
        found = window_values(features, self.layout, torch)
        humans = self.teacher.training.windows.humans[torch.from_numpy(windows.clip)].to(features.device)
        body = points(segments(pose(features, self.layout, humans), humans), humans)
        places = (body / humans.leg[:, None, None, None]).flatten(2)
        cut, limits = self.constraints.blocks[PLACES], self.constraints.blocks[TORQUE_LIMITS]
        found = torch.cat([found[..., : cut.start], places, found[..., cut.stop :]], dim=-1)
        error = (found - asked.values) * self._weight / HUBER
        beyond = (found[..., limits].abs() - asked.values[..., limits]).clamp(min=0) * self._weight[limits] / HUBER
        error = torch.cat([error[..., : limits.start], beyond, error[..., limits.stop :]], dim=-1)
        size = error.abs()
        loss = torch.where(size < 1.0, 0.5 * error.square(), size - 0.5)
        return (loss * asked.mask).sum(dim=(1, 2)) / asked.mask.sum(dim=(1, 2)).clamp(min=1.0)

    def _restored(self, normalised: Tensor) -> Tensor:
        return normalised * self._spread + self._mean
