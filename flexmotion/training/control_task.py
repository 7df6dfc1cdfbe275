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
from flexmotion.features.constraint_layout import FORCES, PLACES, TORQUE_LIMITS, ConstraintLayout, window_values
from flexmotion.spatial.gravity import GRAVITY
from flexmotion.training.ahead import Ahead
from flexmotion.training.conditions import Conditions
from flexmotion.training.constraint_draws import DRAWS, ESTIMATED, draw_constraints
from flexmotion.training.control_branch import ConstrainedDenoiser, ControlBranch
from flexmotion.training.denoiser import Denoiser
from flexmotion.training.diffusion_task import DiffusionTask, Drawn
from flexmotion.training.draws import normal, uniform
from flexmotion.training.human_tensors import HumanTensors
from flexmotion.training.kinematics import Segments, points, pose, segments
from flexmotion.training.windows import Windows

VALIDATION = 192
"""Windows of the validation, always the same."""

APART = 2
"""Frames between the places from which accelerations are taken: what is shorter is low-passed in a delivered window."""

HUBER, HUBER_ESTIMATED = 10.0, 1.0
"""Tolerances of a value from which on its loss is linear: far off, a constraint must not outweigh all others. Places
are off by forty where they are not told, forces and activations (`ESTIMATED`) by one or two: over 10 tolerances their
loss was .01 beside 1 of a hand, and they were not learnt."""


@dataclass(frozen=True)
class Asked:
    """What is asked of windows: values and mask, (N, W, C), and of each window the number of its kind, (N,)."""

    values: Tensor
    mask: Tensor
    kinds: np.ndarray

    def to(self, device: torch.device) -> Asked:
        """On another device."""
        return Asked(self.values.to(device), self.mask.to(device), self.kinds)


@dataclass(frozen=True)
class Example:
    """Windows on the device of the training, with their latents and what is asked of them."""

    windows: Windows
    conditions: Conditions
    latent: Tensor
    asked: Asked


VERSION = 3
"""Of draws and loss: increased when either changes, for a training that was begun with others does not go on."""


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
        self._statistics = store.statistics
        self._mean, self._spread = (
            torch.from_numpy(value).to(device) for value in (self._statistics.mean, self._statistics.spread)
        )
        far = torch.tensor(self.constraints.tolerances, device=device) * HUBER
        for name in set(ESTIMATED) & set(self.constraints.blocks):
            far[self.constraints.blocks[name]] *= HUBER_ESTIMATED / HUBER
        self._weight = 1.0 / far
        held_out = teacher.held_out.draw((seed, 41), VALIDATION)
        described = teacher.training.describe(held_out, (seed, 42, 1)).to(device)
        self._held_out = self._example(held_out.to(device), described, self._ask(held_out, (seed, 42)).to(device))
        self._ahead: Ahead[tuple[Drawn, Asked]] = Ahead(device)

    def _batch(self, step: int) -> tuple[Drawn, Asked]:
        teacher, batch, key = self.teacher, self.config.stages.control.batch, self._key(step)
        drawn = teacher.drawn((*key, 0), (*key, 1, 1), batch, teacher.roll_out)
        return drawn, self._ask(drawn.windows, (*key, 1))

    def _key(self, step: int) -> tuple[int, ...]:
        return (self.seed, 43, step, self.teacher.processes.rank)

    def losses(self, step: int) -> tuple[Tensor, dict[str, Tensor]]:
        """See `stage.Task`."""
        teacher, batch, key = self.teacher, self.config.stages.control.batch, self._key(step)
        drawn, asked = self._ahead(step, self._batch)
        example = self._example(*teacher.followed(drawn), asked.to(teacher.processes.device))
        found = self._estimate(example, teacher.times((*key, 2), batch), (*key, 3))
        latent = torch.nn.functional.huber_loss(found, example.latent, delta=self.config.distillation.huber)
        kept = self._kept(example, found).mean()
        return kept + self.config.control.latent * latent, {"kept": kept, "latent": latent}

    def close(self) -> None:
        """See `stage.Closing`."""
        self._ahead.close()

    def validate(self) -> dict[str, float]:
        """Loss at the latest time, from which sampling begins, and that of each kind."""
        example = self._held_out
        latest = torch.full((VALIDATION,), self.config.diffusion.steps - 1)
        found = self._estimate(example, latest, (self.seed, 44))
        latent = float(torch.nn.functional.huber_loss(found, example.latent, delta=self.config.distillation.huber))
        kept = self._kept(example, found).cpu().numpy()
        figures = {"loss": float(kept.mean()) + self.config.control.latent * latent, "latent": latent}
        for number, name in enumerate(DRAWS):
            own = kept[example.asked.kinds == number]
            if name != "nothing" and len(own):
                figures[name] = float(own.mean())
        return figures

    def _ask(self, windows: Windows, key: tuple[int, ...]) -> Asked:
        """What is asked of windows, on the CPU."""
        future = torch.from_numpy(self._statistics.restore(windows.future.numpy()))
        values = window_values(future, self.layout, torch).numpy()
        past = windows.history.shape[1]
        known = (windows.good[:, past:] & windows.mask).numpy()
        values, mask, kinds = draw_constraints(np.random.default_rng((*key, 0)), self.constraints, values, known)
        return Asked(torch.from_numpy(values), torch.from_numpy(mask.astype(np.float32)), kinds)

    def _example(self, windows: Windows, conditions: Conditions, asked: Asked) -> Example:
        teacher = self.teacher
        latent = teacher.normalised(teacher.training.encode(windows.history, windows.future))
        return Example(windows, conditions, latent, asked)

    def _estimate(self, example: Example, time: Tensor, key: tuple[int, ...]) -> Tensor:
        """The model's estimate of the clean latents from noisy ones at some times, (N, latent)."""
        teacher, distillation, conditions = self.teacher, self.config.distillation, example.conditions
        device, size = teacher.processes.device, len(example.latent)
        low, high = distillation.guidance_low, distillation.guidance_high
        guidance = (low + (high - low) * uniform((*key, 0), (size, 2))).to(device)
        noise = normal((*key, 1), tuple(example.latent.shape)).to(device)
        time = time.to(device)
        noisy = teacher.noise.add_noise(example.latent, noise, time)
        request = (conditions.sentence, conditions.velocity, conditions.manner, conditions.present)
        with teacher.processes.mixed_precision():
            found: Tensor = self._denoiser(
                noisy, time, example.windows.history, *request, guidance, example.asked.values, example.asked.mask
            )
        return found.float()

    def _kept(self, example: Example, latent: Tensor) -> Tensor:
        """Mean loss of the asked values of each window, see `HUBER`, (N,); 0 where nothing is asked."""
        windows, asked = example.windows, example.asked
        features = self._restored(self.teacher.decode(windows.history, latent).float())
        found = window_values(features, self.layout, torch)
        humans = self.teacher.training.windows.humans[torch.from_numpy(windows.clip)].to(features.device)
        body = segments(pose(features, self.layout, humans), humans)
        places = (points(body, humans) / humans.leg[:, None, None, None]).flatten(2)
        cut, limits = self.constraints.blocks[PLACES], self.constraints.blocks[TORQUE_LIMITS]
        found = torch.cat([found[..., : cut.start], places, found[..., cut.stop :]], dim=-1)
        error = (found - asked.values) * self._weight
        beyond = (found[..., limits].abs() - asked.values[..., limits]).clamp(min=0) * self._weight[limits]
        error = torch.cat([error[..., : limits.start], beyond, error[..., limits.stop :]], dim=-1)
        needed, both = self._needed(body, humans, asked)
        # Loads of variants bear on the ground too.
        unloaded = (windows.future_loads == 0).flatten(2).all(dim=2, keepdim=True)
        both = both * unloaded
        error, mask = torch.cat([error, needed], dim=-1), torch.cat([asked.mask, both], dim=-1)
        size = error.abs()
        loss = torch.where(size < 1.0, 0.5 * error.square(), size - 0.5)
        return (loss * mask).sum(dim=(1, 2)) / mask.sum(dim=(1, 2)).clamp(min=1.0)

    def _needed(self, body: Segments, humans: HumanTensors, asked: Asked) -> tuple[Tensor, Tensor]:
        """How far the force that the motion needs is from the forces that are asked of both feet, and where they are.

        A window is handed on with the ground forces of its motion, whatever the decoder says of them: without this a
        branch learns to change the decoder's forces alone. Like the asked values' errors, (N, W, 3) each.
        """
        forces = self.constraints.blocks[FORCES]
        share = humans.mass / humans.mass.sum(dim=1, keepdim=True)
        centre = (share[:, None, :, None] * body.com).sum(dim=2)
        step = APART / self.layout.fps
        curved = (centre[:, 2 * APART :] - 2 * centre[:, APART:-APART] + centre[:, : -2 * APART]) / step**2
        force = curved / GRAVITY + curved.new_tensor([0.0, 0.0, 1.0])
        told = asked.values[..., forces].unflatten(-1, (2, 3)).sum(dim=2)
        both = asked.mask[..., forces].unflatten(-1, (2, 3)).amin(dim=2)
        error = (force - told[:, APART:-APART]) * self._weight[forces][:3]
        ends = (0, 0, APART, APART)  # frames before the window are not decoded
        return nn.functional.pad(error, ends), nn.functional.pad(both[:, APART:-APART], ends)

    def _restored(self, normalised: Tensor) -> Tensor:
        return normalised * self._spread + self._mean
