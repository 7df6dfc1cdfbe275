"""The distillation's stage: a student that is consistent along the teacher's paths samples in a few steps, not fifty.

Consistency distillation (Song et al., ICML 2023) with the guidance scales as an input (Luo et al., Latent Consistency
Models, 2023): where the teacher steps from a time to an earlier one, the student must estimate the same
clean latent at both. Request and manner have scales of their own (Brooks et al., InstructPix2Pix, CVPR 2023).
"""

from __future__ import annotations

import torch
from torch import Tensor

from flexmotion.configs.model import ModelConfig
from flexmotion.training.denoiser import Denoiser
from flexmotion.training.diffusion_task import DiffusionTask
from flexmotion.training.draws import normal, uniform
from flexmotion.training.examples import Examples, SetExamples


def guided(full: Tensor, any_manner: Tensor, unconditional: Tensor, guidance: Tensor) -> Tensor:
    """The estimate under guidance, (N, latent).

    Args:
        full: estimate with all conditions, (N, latent).
        any_manner: without the manner.
        unconditional: without any.
        guidance: scales of the request and of its manner, (N, 2).
    """
    asked = unconditional + guidance[:, :1] * (any_manner - unconditional)
    return asked + guidance[:, 1:] * (full - any_manner)


class DistillationTask:
    """Training of the student; see `stage.Task`.

    Args:
        config: of the model.
        teacher: trained diffusion; kept as it is.
        seed: of all draws.
        examples: windows that the student is trained on; None: those of the teacher's set.
    """

    def __init__(
        self, config: ModelConfig, teacher: DiffusionTask, seed: int, examples: Examples | None = None
    ) -> None:
        torch.manual_seed(seed)
        self.config, self.teacher, self.seed = config, teacher, seed
        self.examples = SetExamples(teacher) if examples is None else examples
        teacher.network.eval().requires_grad_(False)
        layout = teacher.training.store.layout
        network = Denoiser(config.diffusion, config.window, layout, teacher.autoencoder.latent, guided=True)
        network.load_state_dict(teacher.network.state_dict(), strict=False)
        self.network = network.to(teacher.processes.device)
        distillation = config.distillation
        self._grid = torch.linspace(0, config.diffusion.steps - 1, distillation.grid).round().long()

    def losses(self, step: int) -> tuple[Tensor, dict[str, Tensor]]:
        """See `stage.Task`."""
        return self._losses((self.seed, 31, step, self.teacher.processes.rank), self.config.stages.distill.batch)

    def _losses(self, key: tuple[int, ...], batch: int) -> tuple[Tensor, dict[str, Tensor]]:
        teacher, distillation = self.teacher, self.config.distillation
        device, example = teacher.processes.device, self.examples.draw(key, batch)
        history, latent, conditions = example.history, example.latent, example.conditions
        place = (uniform((*key, 2), (batch,)) * distillation.grid).long()
        earlier_place = place - distillation.skip
        time = self._grid[place].to(device)
        earlier = torch.where(earlier_place < 0, -1, self._grid[earlier_place.clamp(min=0)]).to(device)
        low, high = distillation.guidance_low, distillation.guidance_high
        guidance = (low + (high - low) * uniform((*key, 3), (batch, 2))).to(device)
        noise = normal((*key, 4), tuple(latent.shape)).to(device)
        noisy = teacher.noise.add_noise(latent, noise, time)
        with torch.no_grad(), teacher.processes.mixed_precision():
            full, any_manner, unconditional = (
                teacher.denoise(noisy, time, history, one).float()
                for one in (conditions, conditions.without_manner(), conditions.unconditional())
            )
            clean = guided(full, any_manner, unconditional, guidance)
            stepped = teacher.noise.step(noisy, clean, time, earlier)
            request = (conditions.sentence, conditions.velocity, conditions.manner, conditions.present)
            inputs = (history, *request, guidance)
            target = self.network(stepped, earlier.clamp(min=0), *inputs).float()
            target = torch.where(earlier[:, None] < 0, clean, target)
        with teacher.processes.mixed_precision():
            found = self.network(noisy, time, *inputs)
        delta = distillation.huber
        loss = torch.nn.functional.huber_loss(found.float(), target, delta=delta)
        return loss, {"consistency": loss}

    def validate(self) -> dict[str, float]:
        """Loss on the same windows every time."""
        loss, _ = self._losses((self.seed, 32), 512)
        return {"loss": float(loss)}
