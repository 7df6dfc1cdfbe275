"""The distillation's stage: a student with the guidance scales as an input, one evaluation for three of its teacher.

Distillation of guidance (Meng et al., On Distillation of Guided Diffusion Models, CVPR 2023, first stage): at every
time the student makes the estimate that its teacher makes under guidance. It begins as its teacher without guidance.
Request and manner have scales of their own (Brooks et al., InstructPix2Pix, CVPR 2023).
"""

from __future__ import annotations

from functools import cached_property, partial

import torch
from torch import Tensor

from flexmotion.configs.model import ModelConfig
from flexmotion.training.denoiser import Denoiser
from flexmotion.training.diffusion_task import DiffusionTask
from flexmotion.training.draws import normal, uniform
from flexmotion.training.examples import Example, Examples, SetExamples

VALIDATION = 256
"""Windows whose samples are compared with the teacher's."""

USUAL = 0.5
"""Share of samples at the scale that most kinds are sampled at, in the normal manner. Without them a student of 500
steps bent the elbow of a hand that is held out by 12° more than people, its teacher by 5°."""


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

    def losses(self, step: int) -> tuple[Tensor, dict[str, Tensor]]:
        """See `stage.Task`."""
        return self._losses((self.seed, 31, step, self.teacher.processes.rank), self.config.stages.distill.batch)

    def _losses(self, key: tuple[int, ...], batch: int) -> tuple[Tensor, dict[str, Tensor]]:
        teacher, example = self.teacher, self.examples.draw(key, batch)
        device, latent = teacher.processes.device, example.latent
        time = teacher.times((*key, 2), batch).to(device)
        guidance = self._guidance((*key, 3), batch)
        noise = normal((*key, 4), tuple(latent.shape)).to(device)
        noisy = teacher.noise.add_noise(latent, noise, time)
        with torch.no_grad(), teacher.processes.mixed_precision():
            target = self._taught(example, guidance, noisy, time)
        with teacher.processes.mixed_precision():
            found = self._estimated(example, guidance, noisy, time)
        loss = torch.nn.functional.huber_loss(found.float(), target, delta=self.config.distillation.huber)
        return loss, {"guided": loss}

    def validate(self) -> dict[str, float]:
        """How far the student's samples are from its teacher's, after the same noise and at the same guidance."""
        example, guidance, noise, expected = self._samples
        steps = self.config.distillation.sampling_steps
        with torch.no_grad(), self.teacher.processes.mixed_precision():
            found = self.teacher.noise.denoised(noise, steps, partial(self._estimated, example, guidance))
        return {"loss": float((found - expected).square().mean())}

    @cached_property
    def _samples(self) -> tuple[Example, Tensor, Tensor, Tensor]:
        """Windows of the validation, guidance, noise, and the latents that the teacher makes of it."""
        teacher, steps = self.teacher, self.config.diffusion.sampling_steps
        example = self.examples.draw((self.seed, 32), VALIDATION)
        noise = normal((self.seed, 33), tuple(example.latent.shape)).to(teacher.processes.device)
        guidance = self._guidance((self.seed, 34), VALIDATION)
        with torch.no_grad(), teacher.processes.mixed_precision():
            expected = teacher.noise.denoised(noise, steps, partial(self._taught, example, guidance))
        return example, guidance, noise, expected

    def _guidance(self, key: tuple[int, ...], count: int) -> Tensor:
        """Scales of requests and of their manners, (N, 2)."""
        distillation = self.config.distillation
        low, high = distillation.guidance_low, distillation.guidance_high
        scales = low + (high - low) * uniform((*key, 0), (count, 2))
        usual = scales.new_tensor([self.config.diffusion.guidance, low])
        scales = torch.where(uniform((*key, 1), (count, 1)) < USUAL, usual, scales)
        return scales.to(self.teacher.processes.device)

    def _estimated(self, example: Example, guidance: Tensor, noisy: Tensor, time: Tensor) -> Tensor:
        """The student's estimate of the clean latents."""
        asked = example.conditions
        request = (asked.sentence, asked.velocity, asked.manner, asked.present)
        clean: Tensor = self.network(noisy, time, example.history, *request, guidance)
        return clean

    def _taught(self, example: Example, guidance: Tensor, noisy: Tensor, time: Tensor) -> Tensor:
        """The teacher's estimate of the clean latents, under guidance."""
        asked = example.conditions
        full, any_manner, unconditional = (
            self.teacher.denoise(noisy, time, example.history, one).float()
            for one in (asked, asked.without_manner(), asked.unconditional())
        )
        return guided(full, any_manner, unconditional, guidance)
